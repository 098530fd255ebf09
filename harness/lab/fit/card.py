"""Model cards: what a model was fitted to, how good it is, and its limitations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
    regimes: Sequence[RegimeError],
    limits: Sequence[str],
) -> None:
    """Write a model card.

    Args:
        regimes: Closed-loop errors by regime; may be empty.
        limits: Known limits, one sentence each.
    """
    lines = [f"# {title}", "", *(f"- **{name}**: {value}" for name, value in facts.items()), ""]
    if regimes:
        heads = ["regime", "cases", *(f"{horizon:g} s" for horizon in HORIZONS_S)]
        rows = [[entry.regime, str(entry.cases), *(f"{error:.2f}" for error in entry.lon_m)] for entry in regimes]
        lines += ["## Position error by regime, complete occlusion, held-out seeds, m", ""]
        lines += [*markdown_table(heads, rows), ""]
    lines += ["## Known limits", "", *(f"- {limit}" for limit in limits), ""]
    write_text(path, "\n".join(lines))


STOP_AND_GO_BELOW_MPS = 3.0
CASES, PARTICLES = 150, 100


@dataclass(frozen=True)
class RegimeError:
    """Position errors of one traffic regime, complete occlusion: mean absolute ones at 1, 2, 5 and 10 s.

    Attributes:
        regime: Name of the regime.
        cases: Number of windows.
        lon_m: Mean absolute error at 1, 2, 5 and 10 s.
    """

    regime: str
    cases: int
    lon_m: tuple[float, ...]


def errors_by_regime(model: MotionModel, windows: CarFollowing, step_s: float, seed: int) -> list[RegimeError]:
    """Return the closed-loop errors in free driving, following, stop-and-go and after a cut-in."""
    return [_errors(model, name, taken(windows, chosen), step_s, seed) for name, chosen in regimes_of(windows).items()]


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


def _errors(model: MotionModel, regime: str, windows: CarFollowing, step_s: float, seed: int) -> RegimeError:
    if not len(windows):
        return RegimeError(regime, 0, (float("nan"),) * len(HORIZONS_S))
    cases = following_cases(windows, CASES, step_s, np.random.default_rng(seed), led_only=False)
    scores = score(follow(model, cases, PARTICLES, np.random.default_rng(seed)), cases)
    steps = [round(horizon / step_s) - 1 for horizon in HORIZONS_S]
    return RegimeError(regime, cases.count, tuple(float(scores.abs_error["lon_m"][step].mean()) for step in steps))
