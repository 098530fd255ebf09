"""The Modified Mixture Particle Filter and its motion models; a library on its own.

The public names are imported on first use, so that ``import mmpf`` costs nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mmpf.motion import motion_model
    from mmpf.motion.protocol import MotionModel, Surroundings, motion_models
    from mmpf.options import FilterOptions
    from mmpf.road import Lane, Road, highway
    from mmpf.scan import Detections, EgoPose, FreeSpace, InvalidScanError, Scan, SensorModel
    from mmpf.tracker import MixtureTracker
    from mmpf.tracks import Tracks

_HOME = {
    "Detections": "mmpf.scan",
    "EgoPose": "mmpf.scan",
    "FilterOptions": "mmpf.options",
    "FreeSpace": "mmpf.scan",
    "InvalidScanError": "mmpf.scan",
    "Lane": "mmpf.road",
    "MixtureTracker": "mmpf.tracker",
    "MotionModel": "mmpf.motion.protocol",
    "Road": "mmpf.road",
    "Scan": "mmpf.scan",
    "SensorModel": "mmpf.scan",
    "Surroundings": "mmpf.motion.protocol",
    "Tracks": "mmpf.tracks",
    "highway": "mmpf.road",
    "motion_model": "mmpf.motion",
    "motion_models": "mmpf.motion.protocol",
}

__all__ = [
    "Detections",
    "EgoPose",
    "FilterOptions",
    "FreeSpace",
    "InvalidScanError",
    "Lane",
    "MixtureTracker",
    "MotionModel",
    "Road",
    "Scan",
    "SensorModel",
    "Surroundings",
    "Tracks",
    "highway",
    "motion_model",
    "motion_models",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401  the type is the name's own
    if name not in _HOME:
        raise AttributeError(f"module 'mmpf' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)
