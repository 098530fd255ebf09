"""Model cards: what a model was fitted to, how good it is, and its limitations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from harness.common.files import write_text
from harness.common.markdown import markdown_table
from harness.lab.windows.car_following import CarFollowing
from harness.lab.windows.cases import following_cases
from harness.lab.windows.filtering import follow
from harness.lab.windows.scores import HORIZONS_S, score
from mmpf.motion.protocol import MotionModel
from mmpf.numerics.arrays import BoolArray, taken

TRAFFIC = "Traffic"
"""Name of the fact that says which traffic a model was fitted to, as ``traffic_version`` names it."""


def write_card(
    path: Path,
    title: str,
    facts: Mapping[str, str],
    regimes: Sequence[Sequence[str]],
    limits: Sequence[str],
) -> None:
    """Write a model card.

    Args:
        regimes: Rows of ``errors_by_regime``; may be empty.
        limits: Known limits, one sentence each.
    """
    lines = [f"# {title}", "", *(f"- **{name}**: {value}" for name, value in facts.items()), ""]
    if regimes:
        heads = ["regime", "cases", *(f"{horizon:g} s" for horizon in HORIZONS_S)]
        lines += ["## Position error by regime, complete occlusion, held-out seeds, m", ""]
        lines += [*markdown_table(heads, regimes), ""]
    lines += ["## Known limits", "", *(f"- {limit}" for limit in limits), ""]
    write_text(path, "\n".join(lines))


STOP_AND_GO_BELOW_MPS = 3.0
CASES, PARTICLES = 150, 100


def errors_by_regime(model: MotionModel, windows: CarFollowing, step_s: float, seed: int) -> list[list[str]]:
    """Return a row for each regime: its name, how many cases there are, and the position errors under full occlusion.

    Errors are mean absolute ones after 1, 2, 5 and 10 s, in metres; nan without a case.
    """
    steps, rows = [round(horizon / step_s) - 1 for horizon in HORIZONS_S], []
    for regime, chosen in regimes_of(windows).items():
        count, errors = 0, [float("nan")] * len(steps)
        if chosen.any():
            rng = np.random.default_rng(seed)
            cases = following_cases(taken(windows, chosen), CASES, step_s, rng, led_only=False)
            error_m = score(follow(model, cases, PARTICLES, np.random.default_rng(seed)), cases).abs_error["lon_m"]
            count, errors = cases.count, [float(error_m[step].mean()) for step in steps]
        rows.append([regime, str(count), *(f"{error:.2f}" for error in errors)])
    return rows


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
