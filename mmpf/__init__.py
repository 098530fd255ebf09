"""The Modified Mixture Particle Filter and its motion models; a library on its own.

The public names are imported on first use, so that ``import mmpf`` costs nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mmpf.map.lane_graph import without_map
    from mmpf.map.road import Lane, Road, highway
    from mmpf.motion import motion_model
    from mmpf.motion.protocol import Memoryless, MotionModel, Neighbour, Surroundings, motion_models
    from mmpf.options.filter import FilterOptions
    from mmpf.scan import BodySizes, Detections, EgoPose, FreeSpace, InvalidScanError, Scan, SensorModel, check_scan
    from mmpf.stages.prediction import Proposal
    from mmpf.stages.reporting import StepReport
    from mmpf.tracker import MixtureTracker
    from mmpf.tracks import CONFIRMED, HIDDEN, TENTATIVE, Tracks
    from mmpf.undetected.intensity import Unseen as Undetected
    from mmpf.undetected.intensity import UnseenTraffic as UndetectedTraffic
    from mmpf.visibility.range_profile import Reach

# The names that each module gives to the library; ``name=other`` where it has another one there.
_NAMES = {
    "mmpf.visibility.range_profile": "Reach",
    "mmpf.map.lane_graph": "without_map",
    "mmpf.motion": "motion_model",
    "mmpf.motion.protocol": "Memoryless MotionModel Neighbour Surroundings motion_models",
    "mmpf.options.filter": "FilterOptions",
    "mmpf.stages.prediction": "Proposal",
    "mmpf.map.road": "Lane Road highway",
    "mmpf.scan": "BodySizes Detections EgoPose FreeSpace InvalidScanError Scan SensorModel check_scan",
    "mmpf.stages.reporting": "StepReport",
    "mmpf.tracker": "MixtureTracker",
    "mmpf.tracks": "CONFIRMED HIDDEN TENTATIVE Tracks",
    "mmpf.undetected.intensity": "Undetected=Unseen UndetectedTraffic=UnseenTraffic",
}
_HOME = {
    public: (module, own or public)
    for module, names in _NAMES.items()
    for public, _, own in (name.partition("=") for name in names.split())
}

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
    "Proposal",
    "Reach",
    "Road",
    "Scan",
    "SensorModel",
    "StepReport",
    "Surroundings",
    "Tracks",
    "Undetected",
    "UndetectedTraffic",
    "check_scan",
    "highway",
    "motion_model",
    "motion_models",
    "without_map",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401  the type is the name's own
    if name not in _HOME:
        raise AttributeError(f"module 'mmpf' has no attribute {name!r}")
    module, own = _HOME[name]
    return getattr(importlib.import_module(module), own)
