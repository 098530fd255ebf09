"""The project's own tracker behind the harness's protocol."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import mmpf.motion  # noqa: F401  fills the registry of motion models
from harness.trackers.protocol import TrackerSetting, trackers
from mmpf.motion.learned.driver import load_learned_driver
from mmpf.motion.learned.short_driver import load_short_driver
from mmpf.motion.protocol import MotionModel, motion_models
from mmpf.options import FilterOptions
from mmpf.tracker import MixtureTracker

# The models that are fitted to data, and so can come from a file of the user's own.
MODEL_LOADERS: dict[str, Callable[[Path], MotionModel]] = {"gmm": load_learned_driver, "gmm-short": load_short_driver}


class MixtureTrackerOptions(FilterOptions):
    """The filter's settings and its motion model."""

    model: str = "gmm"
    """Name of the motion model."""
    model_file: Path | None = None
    """File that the model is read from; the one that travels with the package if None."""


@trackers.register("mmpf")
def build_mixture_tracker(setting: TrackerSetting, options: Mapping[str, object]) -> MixtureTracker:
    """Build the Modified Mixture Particle Filter.

    Raises:
        UnknownNameError: There is no such motion model.
        ModelFileError: The model's file can't be used.
        ValueError: A file is given for a model that is not read from one.
        pydantic.ValidationError: An option does not exist or has an impossible value.
    """
    values: dict[str, Any] = MixtureTrackerOptions.model_validate(dict(options)).model_dump()
    motion = _motion_model(values.pop("model"), values.pop("model_file"))
    return MixtureTracker(setting.road, setting.sensor, motion, setting.rng, FilterOptions(**values))


def _motion_model(name: str, file: Path | None) -> MotionModel:
    model = motion_models[name]
    if file is None:
        return model()
    if name not in MODEL_LOADERS:
        raise ValueError(f"model_file: the model {name!r} is not read from a file; choose {' or '.join(MODEL_LOADERS)}")
    return MODEL_LOADERS[name](file)
