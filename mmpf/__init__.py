"""The Modified Mixture Particle Filter and its motion models; a library on its own.

The public names are imported on first use, so that ``import mmpf`` costs nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mmpf.map.road import Lane, Road, highway
    from mmpf.motion import motion_model
    from mmpf.motion.protocol import Memoryless, MotionModel, Neighbour, Surroundings, motion_models
    from mmpf.options.filter import FilterOptions
    from mmpf.scan import BodySizes, Detections, EgoPose, FreeSpace, InvalidScanError, Scan, SensorModel, check_scan
    from mmpf.stages.reporting import StepReport
    from mmpf.tracker import MixtureTracker
    from mmpf.tracks import CONFIRMED, HIDDEN, TENTATIVE, Tracks

# The names that each module gives to the library.
_NAMES = {
    "mmpf.motion": "motion_model",
    "mmpf.motion.protocol": "Memoryless MotionModel Neighbour Surroundings motion_models",
    "mmpf.options.filter": "FilterOptions",
    "mmpf.map.road": "Lane Road highway",
    "mmpf.scan": "BodySizes Detections EgoPose FreeSpace InvalidScanError Scan SensorModel check_scan",
    "mmpf.stages.reporting": "StepReport",
    "mmpf.tracker": "MixtureTracker",
    "mmpf.tracks": "CONFIRMED HIDDEN TENTATIVE Tracks",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = [
    "CONFIRMED",
    "HIDDEN",
    "TENTATIVE",
    "BodySizes",
    "Detections",
    "EgoPose",
    "FilterOptions",
    "FreeSpace",
    "InvalidScanError",
    "Lane",
    "Memoryless",
    "MixtureTracker",
    "MotionModel",
    "Neighbour",
    "Road",
    "Scan",
    "SensorModel",
    "StepReport",
    "Surroundings",
    "Tracks",
    "check_scan",
    "highway",
    "motion_model",
    "motion_models",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401  the type is the name's own
    if name not in _HOME:
        raise AttributeError(f"module 'mmpf' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)
