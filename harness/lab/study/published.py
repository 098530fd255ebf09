"""The two studies with their traffic and models."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.lab.study.study import COMPLETE, PARTIAL, StudyResult, run_study
from harness.lab.windows.car_following import load_following
from harness.lab.windows.cases import following_cases, lane_change_cases
from harness.lab.windows.changing import load_changes
from harness.lab.windows.filtering import NOISE
from harness.lab.windows.recording import DENSITIES_VEH_PER_KM_LANE, REPORTING_DURATION_S, first_to_last, record_traffic
from harness.trackers.mmpf import MODEL_LOADERS
from harness.truth.network.network import Network
from mmpf.motion.gmm.model_file import ModelFileError
from mmpf.motion.learned.driver import LearnedDriver
from mmpf.motion.learned.trial import check_that_it_drives
from mmpf.motion.protocol import MotionModel, motion_models

LANE_KEEPING, LANE_CHANGE = "lane-keeping", "lane-change"
KINEMATIC, IDM = ("cvm", "cam", "csav", "csaa"), ("idm", "idm-fitted", "idm-adaptive")
MODELS = {
    LANE_KEEPING: ("residual", "recurrent", "gmm", "empirical", "gmm-short", *IDM, *KINEMATIC),
    LANE_CHANGE: ("gmm", "gmm-lane-change", *KINEMATIC),
}
OCCLUSIONS = {LANE_KEEPING: (PARTIAL, COMPLETE), LANE_CHANGE: (PARTIAL,)}


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
    result = run_study(
        plan.study,
        cases,
        dict.fromkeys(OCCLUSIONS[plan.study], models),
        particles=plan.particles,
        seed=plan.seed,
        progress=progress,
    )
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
