"""How a fitted model does on traffic that it was not trained on: the numbers of a model card."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.study.cases import Cases, following_cases
from harness.study.filtering import follow
from harness.study.scores import score
from harness.training.following import Following
from mmpf.motion.protocol import MotionModel

STOP_AND_GO_BELOW_MPS = 3.0
HORIZONS_S = (1.0, 2.0, 5.0, 10.0)
CASES, PARTICLES = 150, 100


@dataclass(frozen=True)
class RegimeError:
    """Position errors of one traffic regime under complete occlusion.

    Attributes:
        regime: Name of the regime.
        cases: Number of windows.
        lon_m: Mean absolute error at 1, 2, 5 and 10 s.
    """

    regime: str
    cases: int
    lon_m: tuple[float, ...]


def errors_by_regime(model: MotionModel, windows: Following, step_s: float, seed: int) -> list[RegimeError]:
    """Return the closed-loop errors in free driving, following, stop-and-go and after a cut-in."""
    slowest = windows.speed_mps.min(axis=1)
    led = windows.has_leader
    stop_and_go = led & (slowest < STOP_AND_GO_BELOW_MPS)
    regimes = {
        "free": ~led,
        "following": led & ~stop_and_go & ~windows.after_cut_in,
        "stop-and-go": stop_and_go,
        "cut-in": led & windows.after_cut_in,
    }
    return [
        _errors(model, name, windows.take(np.flatnonzero(chosen)), step_s, seed) for name, chosen in regimes.items()
    ]


def _errors(model: MotionModel, regime: str, windows: Following, step_s: float, seed: int) -> RegimeError:
    if not len(windows):
        return RegimeError(regime, 0, (float("nan"),) * len(HORIZONS_S))
    cases: Cases = following_cases(windows, CASES, step_s, np.random.default_rng(seed), led_only=False)
    scores = score(follow(model, cases, PARTICLES, np.random.default_rng(seed)), cases)
    steps = [round(horizon / step_s) - 1 for horizon in HORIZONS_S]
    return RegimeError(regime, cases.count, tuple(float(scores.abs_error["lon_m"][step].mean()) for step in steps))
