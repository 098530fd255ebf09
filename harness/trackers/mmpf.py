"""The project's own tracker behind the harness's protocol."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import ConfigDict

import mmpf.motion  # noqa: F401  fills the registry of motion models
from harness.trackers.protocol import TrackerSetting, trackers
from mmpf.motion.protocol import motion_models
from mmpf.options import FilterOptions
from mmpf.tracker import MixtureTracker


class MixtureTrackerOptions(FilterOptions):
    """The filter's settings and the name of its motion model.

    Attributes:
        model: Name of the motion model.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    model: str = "gmm"


@trackers.register("mmpf")
def build_mixture_tracker(setting: TrackerSetting, options: Mapping[str, object]) -> MixtureTracker:
    """Build the Modified Mixture Particle Filter.

    Raises:
        UnknownNameError: There is no such motion model.
        pydantic.ValidationError: An option does not exist or has an impossible value.
    """
    values: dict[str, Any] = MixtureTrackerOptions.model_validate(dict(options)).model_dump()
    motion = motion_models[values.pop("model")]()
    return MixtureTracker(setting.road, setting.sensor, motion, setting.rng, FilterOptions(**values))
