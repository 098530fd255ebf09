"""The project's own tracker behind the harness's protocol."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.error_text import what_it_raised
from harness.common.isolation import ProcessLimits, isolated
from harness.trackers.protocol import TrackerSetting
from mmpf.motion.gmm.model_file import ModelFileError
from mmpf.motion.learned.driver import empirical_driver, load_learned_driver, recurrent_driver, residual_driver
from mmpf.motion.learned.short_driver import load_short_driver
from mmpf.motion.learned.trial import check_that_it_drives
from mmpf.motion.protocol import MotionModel, MotionModelFactory, motion_models
from mmpf.motion.state import SPEED, STATE_SIZE
from mmpf.options.filter import FilterOptions
from mmpf.registry import UnknownNameError
from mmpf.tracker import MixtureTracker

# The models that are fitted to data, and so can come from a file of the user's own.
MODEL_LOADERS: dict[str, Callable[[Path], MotionModel]] = {
    **{"residual": residual_driver, "gmm": load_learned_driver, "gmm-short": load_short_driver},
    **{"recurrent": recurrent_driver, "empirical": empirical_driver},
}

# A motion model from outside is tried on two vehicles at this speed before a run begins.
TRIAL_SPEED_MPS = 20.0


class MixtureTrackerOptions(FilterOptions):
    """The filter's settings and its motion model."""

    model: str = "residual"
    """Name of the motion model."""
    model_file: Path | None = None
    """File that the model is read from; the one that travels with the package if None."""


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
        return model() if name in motion_models.own else _checked(name, model)
    if name not in MODEL_LOADERS:
        raise ValueError(f"model_file: the model {name!r} is not read from a file; choose {' or '.join(MODEL_LOADERS)}")

    def read() -> MotionModel | ModelFileError:
        try:
            return MODEL_LOADERS[name](file)
        except ModelFileError as error:
            return error

    model_read = isolated(read, f"model file {file}", ProcessLimits.for_files([file]))
    if isinstance(model_read, ModelFileError):
        raise model_read
    check_that_it_drives(model_read, file)
    return model_read


def _checked(name: str, factory: MotionModelFactory) -> MotionModel:
    """Return another package's motion model, if it is one."""
    try:
        model = factory()
        latents: object = None
        missing = [part for part in ("name", "latent_size", "draw_latents", "propagate") if not hasattr(model, part)]
        if not missing:
            state = np.zeros((STATE_SIZE, 2))
            state[SPEED] = TRIAL_SPEED_MPS
            latents = model.draw_latents(state, np.random.default_rng(0))
    except Exception as error:
        raise UnknownNameError(f"the motion model {name} can't be built ({what_it_raised(error)}); fix it") from error
    if missing:
        raise UnknownNameError(f"the motion model {name} is {type(model).__name__}, which has no {missing[0]}; fix it")
    if not isinstance(latents, np.ndarray) or latents.shape != (model.latent_size, 2):
        found = f"shape {latents.shape}" if isinstance(latents, np.ndarray) else type(latents).__name__
        raise UnknownNameError(
            f"the motion model {name}: draw_latents returned {found} for 2 particles, not (latent_size, 2) = "
            f"({model.latent_size}, 2); fix it"
        )
    return model
