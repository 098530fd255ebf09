# The public names; ``plugins.py`` beside it reads them here.

from harness.config.sensor import SensorSettings as SensorSettings
from harness.decisions.belief import Belief as Belief
from harness.decisions.belief import Beside as Beside
from harness.decisions.belief import Others as Others
from harness.decisions.drivers.protocol import Command as Command
from harness.decisions.drivers.protocol import Driver as Driver
from harness.decisions.drivers.protocol import DriverFactory as DriverFactory
from harness.running.finished import RecordedRun as RecordedRun
from harness.scoring.gathered import Evidence as Evidence
from harness.scoring.metrics.parts import InParts as InParts
from harness.scoring.metrics.quantity import Quantity as Quantity
from harness.scoring.metrics.registry import register as register_metric
from harness.sensor.profiles import sensor_settings as sensor_settings
from harness.trackers.conformance.checks import check_tracker as check_tracker
from harness.trackers.conformance.checks import tracker_checks as tracker_checks
from harness.trackers.protocol import TellsUnseen as TellsUnseen
from harness.trackers.protocol import Tracker as Tracker
from harness.trackers.protocol import TrackerFactory as TrackerFactory
from harness.trackers.protocol import TrackerSetting as TrackerSetting
from harness.trackers.protocol import TruthAssociatedTracker as TruthAssociatedTracker
from harness.truth.recorded.rows import ReadTraffic as ReadTraffic
from harness.truth.recorded.rows import Rows as Rows
from harness.truth.recorded.rows import unknown as unknown
from harness.truth.recorded.source import open_recorded_traffic as open_recorded_traffic
