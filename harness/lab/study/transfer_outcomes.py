"""Results of the transfer study: each model's errors, and which models differ."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.bootstrap import bootstrap_ci
from harness.lab.windows.cases import Cases
from harness.lab.windows.scores import RESAMPLES, Scores
from mmpf.motion.protocol import MotionModel
from mmpf.numerics.arrays import FloatArray, IntArray

ON_SUMO, ON_REAL, ON_BOTH, ON_NOTHING = "sumo", "real", "sumo+real", "nothing"
LEARNED, UNTRAINED = ("residual", "gmm", "gmm-short", "idm-fitted"), ("cvm", "cam", "idm")
OURS = ("residual", "gmm", "gmm-short")
RIVALS = (*((name, ON_NOTHING) for name in UNTRAINED), ("idm-fitted", ON_SUMO))


@dataclass(frozen=True)
class TrainedModel:
    """A motion model that keeps its lane, its kind, and what its parameters were fitted to."""

    name: str
    trained_on: str
    model: MotionModel

    @property
    def label(self) -> str:
        """Name for tables and pictures."""
        return self.name if self.trained_on == ON_NOTHING else f"{self.name}, {self.trained_on}"


@dataclass(frozen=True)
class HeldOut:
    """Cases of one length that no model was trained on.

    Attributes:
        vehicle: Vehicle of each case, shape (m,); cases of one vehicle are no independent samples.
    """

    tested_on: str
    cases: Cases
    vehicle: IntArray
    horizons_s: tuple[float, ...]


@dataclass(frozen=True)
class TransferOutcome:
    """How one model did on the cases of one test."""

    model: TrainedModel
    test: HeldOut
    scores: Scores

    def errors_m(self, horizon_s: float) -> FloatArray:
        """Return the absolute longitudinal errors at a horizon, shape (m,)."""
        return np.asarray(self.scores.abs_error["lon_m"][round(horizon_s / self.test.cases.step_s) - 1])


@dataclass(frozen=True)
class ModelComparison:
    """A model trained on simulated traffic alone beside another one, by the mean absolute longitudinal error.

    The difference is the model's less the other's, case by case; its interval is over vehicles.
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


def compare_transfer(outcomes: Sequence[TransferOutcome]) -> list[ModelComparison]:
    """Compare the learned models that know simulated traffic alone with the rivals, and with real training."""
    by_key = {
        (outcome.test.tested_on, horizon, outcome.model.name, outcome.model.trained_on): outcome
        for outcome in outcomes
        for horizon in outcome.test.horizons_s
    }
    return [
        _comparison(by_key[(*place, own, ON_SUMO)], by_key[(*place, *rival)], place[1])
        for place in dict.fromkeys(key[:2] for key in by_key)
        for own in OURS
        for rival in (*RIVALS, (own, ON_REAL))
        if (*place, own, ON_SUMO) in by_key and (*place, *rival) in by_key
    ]


def _comparison(own: TransferOutcome, rival: TransferOutcome, horizon_s: float) -> ModelComparison:
    own_m, rival_m = own.errors_m(horizon_s), rival.errors_m(horizon_s)
    interval = bootstrap_ci(own_m - rival_m, np.random.default_rng(0), own.test.vehicle, draws=RESAMPLES)
    means = float(own_m.mean()), float(rival_m.mean()), float((own_m - rival_m).mean())
    labels = own.model.label, rival.model.label, rival.model.trained_on
    return ModelComparison(own.test.tested_on, horizon_s, *labels, *means, (interval.low, interval.high))


def summary_lines(comparisons: Sequence[ModelComparison]) -> list[str]:
    """Return one line for each test and model trained on simulated traffic: which models it loses to, and when."""
    lines = []
    for tested_on, own in dict.fromkeys((each.tested_on, each.own) for each in comparisons):
        lost = [each for each in comparisons if (each.tested_on, each.own) == (tested_on, own) and not each.better]
        rivals = _by_rival(each for each in lost if each.rival_trained_on != ON_REAL)
        kin = _by_rival(each for each in lost if each.rival_trained_on == ON_REAL)
        lines.append(f"- on {tested_on}, {own} loses to {rivals or 'no rival'}{f'; behind {kin}' if kin else ''}.")
    return lines


def _by_rival(lost: Iterable[ModelComparison]) -> str:
    times: dict[str, list[str]] = {}
    for each in lost:
        times.setdefault(each.rival, []).append(f"{each.horizon_s:g} s{'' if each.clear else ' (not clear)'}")
    return ", ".join(f"{rival} at {' and '.join(when)}" for rival, when in times.items())
