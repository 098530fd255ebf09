"""What trackers, metrics, drivers, sensors, readers and formats of other packages are written with.

Together with ``harness`` and ``mmpf`` this is all that stays where it is: a name is imported from here, never from
deeper. The names are imported on first use, so that ``import harness.plugins`` costs nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.config.sensor import SensorSettings
    from harness.decisions.belief import Belief, Beside, Others
    from harness.decisions.drivers.protocol import Command, Driver, DriverFactory
    from harness.running.finished import RecordedRun
    from harness.scoring.gathered import Evidence
    from harness.scoring.metrics.parts import InParts
    from harness.scoring.metrics.quantity import Quantity
    from harness.scoring.metrics.registry import register as register_metric
    from harness.trackers.conformance.checks import check_tracker, tracker_checks
    from harness.trackers.protocol import TellsUnseen, Tracker, TrackerFactory, TrackerSetting, TruthAssociatedTracker
    from harness.truth.recorded.rows import ReadTraffic, Rows, unknown
    from harness.truth.recorded.source import open_recorded_traffic

# Where each name lives; ``name=other`` where it has another one there.
_NAMES = {
    "harness.decisions.belief": "Belief Beside Others",
    "harness.decisions.drivers.protocol": "Command Driver DriverFactory",
    "harness.running.finished": "RecordedRun",
    "harness.scoring.gathered": "Evidence",
    "harness.scoring.metrics.registry": "register_metric=register",
    "harness.scoring.metrics.parts": "InParts",
    "harness.scoring.metrics.quantity": "Quantity",
    "harness.config.sensor": "SensorSettings",
    "harness.trackers.conformance.checks": "check_tracker tracker_checks",
    "harness.trackers.protocol": "TellsUnseen Tracker TrackerFactory TrackerSetting TruthAssociatedTracker",
    "harness.truth.recorded.rows": "ReadTraffic Rows unknown",
    "harness.truth.recorded.source": "open_recorded_traffic",
}
_HOME = {
    public: (module, own or public)
    for module, names in _NAMES.items()
    for public, _, own in (name.partition("=") for name in names.split())
}

__all__ = [
    "Belief",
    "Beside",
    "Command",
    "Driver",
    "DriverFactory",
    "Evidence",
    "InParts",
    "Others",
    "Quantity",
    "ReadTraffic",
    "RecordedRun",
    "Rows",
    "SensorSettings",
    "TellsUnseen",
    "Tracker",
    "TrackerFactory",
    "TrackerSetting",
    "TruthAssociatedTracker",
    "check_tracker",
    "open_recorded_traffic",
    "register_metric",
    "tracker_checks",
    "unknown",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401  the type is the name's own
    if name not in _HOME:
        raise AttributeError(f"module 'harness.plugins' has no attribute {name!r}")
    module, own = _HOME[name]
    return getattr(importlib.import_module(module), own)
