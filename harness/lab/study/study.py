"""Runs every model over a study's cases and collects the scores as rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from harness.common.bootstrap import independent_ci
from harness.lab.windows.cases import Cases
from harness.lab.windows.filtering import Cloud, follow, measure
from harness.lab.windows.scores import HORIZONS_S, QUANTITIES, Scores, score
from harness.truth.frame import STEP_S
from mmpf.motion.protocol import MotionModel
from mmpf.motion.state import LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray

PARTIAL, COMPLETE = "partial", "complete"
LABELS = dict.fromkeys(("residual", "recurrent", "gmm"), "ours")
LABELS |= dict.fromkeys(("gmm-short", "gmm-lane-change"), "as in the paper")
SHOWN_PARTICLES = 60


@dataclass(frozen=True)
class StudyResult:
    """All of a study's numbers.

    Attributes:
        examples: Particles of the example case, by occlusion and model: longitudinal and lateral position and
            speeds, shape (steps - 1, 4, shown).
        example_truth: True states of the example case, shape (steps, 6).
        rows: What ``results.json`` holds under ``results``.
    """

    study: str
    scores: Mapping[tuple[str, str], Scores]
    examples: Mapping[tuple[str, str], FloatArray]
    example_truth: FloatArray
    rows: Sequence[Mapping[str, Any]]

    def occlusions(self) -> list[str]:
        """Return the occlusions studied, in order."""
        return list(dict.fromkeys(occlusion for occlusion, _ in self.scores))

    def models(self) -> list[str]:
        """Return the models studied, in order."""
        return list(dict.fromkeys(model for _, model in self.scores))


def run_study(
    study: str,
    cases: Cases,
    models: Mapping[str, Mapping[str, MotionModel]],
    *,
    particles: int,
    seed: int,
    progress: Callable[[], None],
) -> StudyResult:
    """Follow every case with every model under every occlusion; all models get the same measurements.

    Args:
        models: Models by name, for each occlusion that is studied: ``partial``, ``complete`` or both.
        progress: Called after each model and occlusion.
    """
    measurements = measure(cases, np.random.default_rng([seed, 1]))
    shown = _most_eventful(cases)
    scores: dict[tuple[str, str], Scores] = {}
    examples: dict[tuple[str, str], FloatArray] = {}
    for occlusion, of_it in models.items():
        seen = measurements if occlusion == PARTIAL else None
        for name, model in of_it.items():
            clouds = follow(model, cases, particles, np.random.default_rng([seed, 2]), seen)
            kept: list[FloatArray] = []
            scores[occlusion, name] = score(_keeping_example(clouds, shown, kept), cases)
            examples[occlusion, name] = np.stack(kept)
            progress()
    rows = [row for key, value in scores.items() for row in _rows(study, *key, value)]
    return StudyResult(study, scores, examples, cases.truth[:, :, shown], rows)


def _rows(study: str, occlusion: str, model: str, scores: Scores) -> list[dict[str, Any]]:
    """Return one row for each horizon and one, without a horizon, for the mean over all steps."""
    steps = {horizon: round(horizon / STEP_S) for horizon in HORIZONS_S}
    at_horizon = [score_row(scores, k - 1, horizon) for horizon, k in steps.items() if k <= len(scores.crps_m)]
    head = {"study": study, "occlusion": occlusion, "model": model, "label": LABELS.get(model, "rival")}
    return [{**head, **row} for row in [*at_horizon, score_row(scores, slice(None), None)]]


def score_row(scores: Scores, steps: int | slice, horizon_s: float | None) -> dict[str, Any]:
    """Return the numbers of one horizon, or of the mean over several steps, counted from the first after the start."""
    rng = np.random.default_rng(0)

    def by_case(values: FloatArray) -> FloatArray:
        return np.asarray(np.atleast_2d(values[steps]).mean(axis=0))

    row: dict[str, Any] = {"horizon_s": horizon_s}
    for name in QUANTITIES:
        errors = by_case(scores.abs_error[name])
        row[name] = float(errors.mean())
        row[f"{name}_ci95"] = list(astuple(independent_ci(errors, rng)))
    for name in ("lon_m", "speed_mps"):
        row[f"coverage95_{name}"] = float(scores.covered[name][steps].mean())
        row[f"spread_{name}"] = float(scores.spread[name][steps].mean())
    row["crps_lon_m"] = float(scores.crps_m[steps].mean())
    row["n"] = scores.crps_m.shape[1]
    return row


def _keeping_example(clouds: Iterator[Cloud], case: int, kept: list[FloatArray]) -> Iterator[Cloud]:
    for cloud in clouds:
        weight = cloud.weight[case]
        chosen = np.searchsorted(np.cumsum(weight), (np.arange(SHOWN_PARTICLES) + 0.5) / SHOWN_PARTICLES)
        chosen = np.minimum(chosen, len(weight) - 1)
        kept.append(cloud.state[[LON, LAT, SPEED, LAT_SPEED], case][:, chosen])
        yield cloud


def _most_eventful(cases: Cases) -> int:
    """Return the case that both speeds up and slows down most."""
    change = np.diff(cases.truth[:, SPEED], axis=0)
    gained, lost = np.maximum(change, 0.0).sum(axis=0), np.maximum(-change, 0.0).sum(axis=0)
    return int(np.argmax(np.minimum(gained, lost)))
