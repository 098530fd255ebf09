"""The models of the transfer study: committed ones, and the same fitted to real and to mixed traffic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.lab.fit.driver_fit import fit_follower, fit_short, situation_columns
from harness.lab.fit.rival_fit import fit_idm
from harness.lab.study.transfer.training_sets import HeldOutSet, Say
from harness.lab.windows.car_following import Following
from harness.truth.frame import STEP_S
from mmpf.motion.idm import intelligent_driver
from mmpf.motion.kinematic import process_noise
from mmpf.motion.learned.driver import LearnedDriver, without_lane_changes
from mmpf.motion.learned.features import situation
from mmpf.motion.learned.short_driver import short_term_driver
from mmpf.motion.protocol import MotionModel, motion_models

COMPONENTS = 28
ON_SUMO, ON_REAL, ON_BOTH, ON_NOTHING = "sumo", "real", "sumo+real", "nothing"
LEARNED = ("gmm", "gmm-short", "idm-fitted")
UNTRAINED = ("cvm", "cam", "idm")


@dataclass(frozen=True)
class TrainedModel:
    """A model and where it has it from.

    Attributes:
        name: Name of the kind of model.
        trained_on: What its parameters were fitted to.
        model: The model; it keeps its lane, as the cases' vehicles do.
    """

    name: str
    trained_on: str
    model: MotionModel

    @property
    def label(self) -> str:
        """Name for tables and pictures."""
        return self.name if self.trained_on == ON_NOTHING else f"{self.name}, {self.trained_on}"


def committed_models() -> list[TrainedModel]:
    """Return the models that travel with the package: trained on simulated traffic, or on nothing."""
    learned = [TrainedModel(name, ON_SUMO, _lane_keeping(motion_models[name]())) for name in LEARNED]
    return [*learned, *(TrainedModel(name, ON_NOTHING, motion_models[name]()) for name in UNTRAINED)]


def fitted_models(windows: Following, trained_on: str, seed: int, say: Say) -> list[TrainedModel]:
    """Fit every learned kind of model to the same windows.

    Of ``gmm`` the following mixture and the drivers' habits are fitted; driving without a leader and motion across the
    lane, in which pairs give no samples and which touch no longitudinal error here, remain the committed ones.

    Args:
        windows: Training windows with leaders.
        trained_on: What they are.
        seed: Seed of samples and fits.
        say: Told one line a stage.
    """
    say(f"{trained_on}: {len(windows)} windows of 10 s")
    following, habit = fit_follower(windows, COMPONENTS, seed, STEP_S, say)
    committed = LearnedDriver().model
    learned = LearnedDriver(replace(committed, following=following, habit=habit))
    say(f"{trained_on}: fitting gmm-short")
    short = short_term_driver(fit_short(windows, COMPONENTS, seed))
    say(f"{trained_on}: fitting idm")
    # The fit takes one window of each vehicle; here it is to take all.
    each_alone = replace(windows, vehicle=np.arange(len(windows)))
    parameters = fit_idm(each_alone, seed, STEP_S)
    driver = intelligent_driver(parameters, process_noise("idm-fitted"), "idm-fitted")
    models: tuple[MotionModel, ...] = (_lane_keeping(learned), short, driver)
    return [TrainedModel(name, trained_on, model) for name, model in zip(LEARNED, models, strict=True)]


def _lane_keeping(model: MotionModel) -> MotionModel:
    return without_lane_changes(model) if isinstance(model, LearnedDriver) else model


INPUTS = ("log gap", "speed, m/s", "acceleration, m/s²", "closing speed, m/s", "leader's acceleration, m/s²")


def input_rows(models: Sequence[TrainedModel], tested: HeldOutSet) -> list[dict[str, Any]]:
    """Return a row for each learned driver and input.

    A row says how the true situations of the test traffic spread, and which share of them lies outside of the range
    of the training data, where the driver takes them for the range's end.

    Args:
        models: Models, of which those of the kind ``gmm`` count.
        tested: Test traffic.
    """
    # All true situations of the windows behind the test set, shape (n, 5).
    seen = situation(*(column.ravel() for column in situation_columns(tested.led)))
    rows = []
    for entry in models:
        if not isinstance(entry.model, LearnedDriver):
            continue
        scaling = entry.model.model.following.scaling
        for place, name in enumerate(INPUTS):
            low, high = float(scaling.input_low[place]), float(scaling.input_high[place])
            values = seen[:, place]
            quantiles = np.quantile(values, (0.05, 0.95))
            rows.append(
                {
                    "tested_on": tested.name,
                    "trained_on": entry.trained_on,
                    "input": name,
                    "from_5_percent": float(quantiles[0]),
                    "to_95_percent": float(quantiles[1]),
                    "std": float(values.std()),
                    "trained_from": low,
                    "trained_to": high,
                    "outside_percent": 100.0 * float(((values < low) | (values > high)).mean()),
                }
            )
    return rows
