"""What simulated training is worth on other traffic, said in so many words: won, lost, or neither."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.bootstrap import bootstrap_ci
from harness.lab.study.transfer.models import ON_NOTHING, ON_REAL, ON_SUMO, UNTRAINED, TrainedModel
from harness.lab.study.transfer.training_sets import HeldOutPart
from harness.lab.windows.scores import RESAMPLES, Scores
from mmpf.numerics.arrays import FloatArray


@dataclass(frozen=True)
class Trend:
    """Where errors come from; arrays over the steps after the start.

    Attributes:
        bias_m: Mean of estimated minus true position.
        accel_kept: How much of the acceleration at the start the estimate still has: regression through the origin.
        accel_kept_true: How much of it the true vehicles still have.
    """

    bias_m: FloatArray
    accel_kept: FloatArray
    accel_kept_true: FloatArray


@dataclass(frozen=True)
class Outcome:
    """How one model did on the cases of one length of one test set.

    Attributes:
        model: The model.
        tested_on: Name of the test set.
        part: The cases.
        scores: Errors, coverage and sharpness.
        trend: What the mean estimate does over time.
    """

    model: TrainedModel
    tested_on: str
    part: HeldOutPart
    scores: Scores
    trend: Trend


OURS = ("gmm", "gmm-short")
RIVALS = (*((name, ON_NOTHING) for name in UNTRAINED), ("idm-fitted", ON_SUMO))


@dataclass(frozen=True)
class Comparison:
    """A model that knows simulated traffic alone held against another one, case by case.

    Attributes:
        tested_on: Name of the test set.
        horizon_s: Time without a measurement.
        own: The model.
        rival: The other one.
        rival_trained_on: What that was trained on.
        lon_m: The model's mean absolute longitudinal error.
        rival_lon_m: The other one's.
        difference_m: One minus the other.
        difference_m_ci95: Its interval over vehicles.
    """

    tested_on: str
    horizon_s: float
    own: str
    rival: str
    rival_trained_on: str
    lon_m: float
    rival_lon_m: float
    difference_m: float
    difference_m_ci95: tuple[float, float]

    @property
    def better(self) -> bool:
        """Whether the model's error is the smaller one."""
        return self.difference_m < 0.0

    @property
    def clear(self) -> bool:
        """Whether the interval leaves no doubt which is better."""
        low, high = self.difference_m_ci95
        return low > 0.0 or high < 0.0


def compare_transfer(outcomes: Sequence[Outcome]) -> list[Comparison]:
    """Hold the learned models that know simulated traffic alone against the rivals, and against real training.

    Every comparison is made case by case; its interval is over vehicles.
    """
    by_key = {
        (outcome.tested_on, outcome.model.name, outcome.model.trained_on, horizon): outcome
        for outcome in outcomes
        for horizon in outcome.part.horizons_s
    }
    return [
        _below(by_key[tested_on, own, ON_SUMO, horizon], by_key[tested_on, name, trained_on, horizon], horizon)
        for tested_on, horizon in dict.fromkeys((tested_on, horizon) for tested_on, _, _, horizon in by_key)
        for own in OURS
        for name, trained_on in (*RIVALS, (own, ON_REAL))
        if (tested_on, own, ON_SUMO, horizon) in by_key and (tested_on, name, trained_on, horizon) in by_key
    ]


def _below(own: Outcome, rival: Outcome, horizon_s: float) -> Comparison:
    own_m, rival_m = (_errors_at(outcome, horizon_s) for outcome in (own, rival))
    interval = bootstrap_ci(own_m - rival_m, np.random.default_rng(0), own.part.vehicle, draws=RESAMPLES)
    return Comparison(
        tested_on=own.tested_on,
        horizon_s=horizon_s,
        own=own.model.label,
        rival=rival.model.label,
        rival_trained_on=rival.model.trained_on,
        lon_m=float(own_m.mean()),
        rival_lon_m=float(rival_m.mean()),
        difference_m=float((own_m - rival_m).mean()),
        difference_m_ci95=(interval.low, interval.high),
    )


def _errors_at(outcome: Outcome, horizon_s: float) -> FloatArray:
    step = round(horizon_s / outcome.part.cases.step_s) - 1
    return np.asarray(outcome.scores.abs_error["lon_m"][step])
