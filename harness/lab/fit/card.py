"""Model cards: what a model was fitted to, how good it is, and its limitations."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from harness.common.files import write_text
from harness.common.markdown import PagePart, markdown_page, markdown_table
from harness.lab.windows.car_following import CarFollowing
from harness.lab.windows.cases import following_cases
from harness.lab.windows.filtering import HORIZONS_S, follow, score
from harness.truth.frame import STEP_S
from mmpf.motion.protocol import MotionModel
from mmpf.numerics.arrays import BoolArray, taken

TRAFFIC = "Traffic"
"""Name of the fact that says which traffic a model was fitted to, as ``traffic_version`` names it."""


def write_card(
    path: Path, title: str, facts: Mapping[str, str], regimes: Sequence[Sequence[str]], limits: Sequence[str]
) -> None:
    """Write a model card with the rows of ``errors_by_regime``, if any, and known limits, one sentence each."""
    parts: list[PagePart] = [f"# {title}", [f"- **{name}**: {value}" for name, value in facts.items()]]
    if regimes:
        heads = ["regime", "cases", *(f"{horizon:g} s" for horizon in HORIZONS_S)]
        parts += ["## Position error by regime, complete occlusion, held-out seeds, m", markdown_table(heads, regimes)]
    parts += ["## Known limits", [f"- {limit}" for limit in limits]]
    write_text(path, markdown_page(parts))


STOP_AND_GO_BELOW_MPS = 3.0
CASES, PARTICLES = 150, 100


def errors_by_regime(model: MotionModel, windows: CarFollowing, seed: int) -> list[list[str]]:
    """Return a row for free driving, following, stop-and-go and after a cut-in: its name, the number of cases, errors.

    Errors are mean absolute ones of the position along the road under complete occlusion at ``HORIZONS_S``, m.
    """
    return [[name, *_errors(model, taken(windows, chosen), seed)] for name, chosen in regimes_of(windows).items()]


def regimes_of(windows: CarFollowing) -> dict[str, BoolArray]:
    """Return which windows are of each regime, by name, each of shape (windows,)."""
    led = windows.has_leader
    stop_and_go = led & (windows.speed_mps.min(axis=1) < STOP_AND_GO_BELOW_MPS)
    return {
        "free": ~led,
        "following": led & ~stop_and_go & ~windows.after_cut_in,
        "stop-and-go": stop_and_go,
        "cut-in": led & windows.after_cut_in,
    }


def _errors(model: MotionModel, windows: CarFollowing, seed: int) -> list[str]:
    if not len(windows):
        return ["0", *["nan"] * len(HORIZONS_S)]
    cases = following_cases(windows, CASES, np.random.default_rng(seed), led_only=False)
    scores = score(follow(model, cases, PARTICLES, np.random.default_rng(seed)), cases)
    steps = [round(horizon / STEP_S) - 1 for horizon in HORIZONS_S]
    return [str(cases.count), *(f"{scores.abs_error['lon_m'][step].mean():.2f}" for step in steps)]
