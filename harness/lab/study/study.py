"""The paper's two studies: their traffic, cases and models, and every model's scores over the cases as rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.common.intervals import clustered_ci
from harness.common.numbers import without_nan
from harness.lab.windows.car_following import load_following
from harness.lab.windows.cases import Cases, following_cases, lane_change_cases
from harness.lab.windows.changing import load_changes
from harness.lab.windows.filtering import HORIZONS_S, NOISE, QUANTITIES, Cloud, Scores, follow, measure, score
from harness.lab.windows.recording import DENSITIES_VEH_PER_KM_LANE, REPORTING_DURATION_S, first_to_last, record_traffic
from harness.trackers.mmpf import MODEL_LOADERS
from harness.truth.frame import STEP_S
from harness.truth.network.network import Network
from mmpf.motion.gmm.model_file import ModelFileError
from mmpf.motion.learned.driver import LearnedDriver
from mmpf.motion.learned.trial import check_that_it_drives
from mmpf.motion.protocol import MotionModel, motion_models
from mmpf.motion.state import LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray

LANE_KEEPING, LANE_CHANGE = "lane-keeping", "lane-change"
KINEMATIC, IDM = ("cvm", "cam", "csav", "csaa"), ("idm", "idm-fitted", "idm-adaptive")
MODELS = {
    LANE_KEEPING: ("residual", "recurrent", "gmm", "empirical", "gmm-short", *IDM, *KINEMATIC),
    LANE_CHANGE: ("gmm", "gmm-lane-change", *KINEMATIC),
}
PARTIAL, COMPLETE = "partial", "complete"
OCCLUSIONS = {LANE_KEEPING: (PARTIAL, COMPLETE), LANE_CHANGE: (PARTIAL,)}
LABELS = dict.fromkeys(("residual", "recurrent", "gmm"), "ours")
LABELS |= dict.fromkeys(("gmm-short", "gmm-lane-change"), "as in the paper")
SHOWN_PARTICLES = 60


@dataclass(frozen=True)
class StudyPlan:
    """The plan of a study.

    Attributes:
        model_file: The user's own fitted model in place of the bundled one: of ``gmm``, or of the one model chosen.
        traffic: Seeds, each of which drives every density.
    """

    study: str
    models: Sequence[str] = ()
    model_file: Path | None = None
    cases: int = 240
    particles: int = 1000
    seed: int = 0
    traffic: range = range(2)
    cache: Path | None = None

    @property
    def model_names(self) -> tuple[str, ...]:
        """Names of the models in the study's order."""
        return tuple(self.models) or MODELS[self.study]

    @property
    def runs(self) -> int:
        """How many times ``progress`` will be called."""
        return len(self.model_names) * len(OCCLUSIONS[self.study])

    def setting(self, network: Network, cases: int) -> dict[str, Any]:
        """Return the setting in numbers, for the results."""
        return {
            "network": network.name,
            "densities_veh_per_km_lane": list(DENSITIES_VEH_PER_KM_LANE),
            "traffic_seeds": first_to_last(self.traffic),
            "cases": cases,
            "particles": self.particles,
            "seed": self.seed,
            "measurement_noise_under_partial_occlusion": dict(NOISE),
            "start": "true state",
            "traffic_around": "true (as in the paper)",
        }


def make_study(
    plan: StudyPlan, network: Network, say: Callable[[str], None], progress: Callable[[], None]
) -> tuple[StudyResult, dict[str, Any]]:
    """Record the traffic where needed and run the study.

    Raises:
        InputError: An unknown study or model, or a model that is not read from a file.
    """
    if plan.study not in MODELS:
        raise InputError(
            f"study {plan.study}: no such study; give {LANE_KEEPING}, {LANE_CHANGE}, situations or ablation"
        )
    models = {name: model_of(plan, name, keeps_lane=plan.study == LANE_KEEPING) for name in plan.model_names}
    paths = record_traffic(network, plan.traffic, REPORTING_DURATION_S, plan.cache, say)
    rng = np.random.default_rng([plan.seed, 0])
    if plan.study == LANE_KEEPING:
        cases = following_cases(load_following(paths, network.road), plan.cases, rng)
    else:
        cases = lane_change_cases(load_changes(paths, network.road), plan.cases, rng)
    result = run_study(plan.study, cases, models, particles=plan.particles, seed=plan.seed, progress=progress)
    return result, plan.setting(network, cases.count)


def model_of(plan: StudyPlan, name: str, keeps_lane: bool) -> MotionModel:
    """Return a model, from the plan's file if that is of it.

    Args:
        keeps_lane: Whether the model is to know that a vehicle keeps its lane.

    Raises:
        InputError: The file can't be used, or such a model is not read from one.
    """
    of_file = plan.models[0] if len(plan.models) == 1 else "gmm"
    if plan.model_file is None or name != of_file:
        model = motion_models[name]()
    elif name not in MODEL_LOADERS:
        raise InputError(f"`model_file`: {name} is not read from a file; choose {' or '.join(MODEL_LOADERS)}")
    else:
        try:
            model = MODEL_LOADERS[name](plan.model_file)
            check_that_it_drives(model, plan.model_file)
        except ModelFileError as error:
            raise InputError(f"`model_file` {plan.model_file}: {error}") from error
    return replace(model, changes_lanes=False) if keeps_lane and isinstance(model, LearnedDriver) else model


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
    models: Mapping[str, MotionModel],
    *,
    particles: int,
    seed: int,
    progress: Callable[[], None],
) -> StudyResult:
    """Follow every case with every model under every occlusion of a study; all models get the same measurements.

    ``progress`` is called after each model and occlusion.
    """
    measurements = measure(cases, np.random.default_rng([seed, 1]))
    # The case that both speeds up and slows down most.
    change = np.diff(cases.truth[:, SPEED], axis=0)
    gained, lost = np.maximum(change, 0.0).sum(axis=0), np.maximum(-change, 0.0).sum(axis=0)
    shown = int(np.argmax(np.minimum(gained, lost)))
    scores: dict[tuple[str, str], Scores] = {}
    examples: dict[tuple[str, str], FloatArray] = {}
    for occlusion in OCCLUSIONS[study]:
        seen = measurements if occlusion == PARTIAL else None
        for name, model in models.items():
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

    def by_case(values: FloatArray) -> FloatArray:
        return np.asarray(np.atleast_2d(values[steps]).mean(axis=0))

    row: dict[str, Any] = {"horizon_s": horizon_s}
    for name in QUANTITIES:
        errors = by_case(scores.abs_error[name])
        row[name] = float(errors.mean())
        # Vehicles of one recording drive together: the recordings are the independent samples.
        row[f"{name}_ci95"] = without_nan(astuple(clustered_ci(errors, scores.traffic)))
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
