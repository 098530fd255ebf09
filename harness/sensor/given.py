"""A recorded sensor: its detections are those of a real detector, stored beside the truth.

How far they are off is what the sensor's figures say of a vehicle in plain view. A vehicle is hidden here while no
detection has been of it for half a second or longer, whatever the reason, since nobody knows how much of it the real
sensor saw; its visible fraction is that of its label among the other labels, from above, and is only told.
"""

from dataclasses import dataclass, replace

import numpy as np

from harness.config.sensor import SensorSettings
from harness.sensor.detector import as_score, confused, data_sheet, own_shadows, rounded, visibility_of
from harness.sensor.noise import position_std
from harness.sensor.observation import Observation
from harness.sensor.scene import in_reach, sight_to
from harness.storage.schema import HIDDEN, OUT, PARTIAL, VISIBLE
from harness.truth.frame import Frame
from harness.truth.recorded.detected.origin import NOTHING
from harness.truth.recorded.detected.recorded_drive import GivenBoxes
from harness.truth.recorded.detected.source import DriveTruth
from mmpf.map.road import Road
from mmpf.scan import BodyHeadings, BodySizes, Detections, EgoPose, Scan, SensorModel

SMALLEST_BOX_M = 0.3
# Of PointRCNN on the training sequences of KITTI: 0.023 rad in a robust sense, with long tails; 2 % are turned round.
STD_HEADING_RAD, FLIP_PROBABILITY = 0.05, 0.03


@dataclass(frozen=True)
class GivenDetections:
    """Hands out the detections of drives.

    Attributes:
        settings: What is said of the detector: its reach, its data sheet and how far its boxes are off.
        truth: The drives.
        scores: The detector's score that true and false detections have alike often, and by how much it grows until
            the odds are e times as high; None of one whose scores mean nothing.
    """

    settings: SensorSettings
    truth: DriveTruth
    scores: tuple[float, float] | None = None

    def model(self, road: Road | None = None) -> SensorModel:
        """Return the data sheet; see ``data_sheet``."""
        return data_sheet(self.settings, road)

    def observe(self, frame: Frame, road: Road, rng: np.random.Generator) -> Observation:
        """Hand out the detections of a frame of the drives; nothing is drawn of those that a detector found.

        Vehicles out of range and labelled objects other than vehicles are out: nobody is judged on them.
        """
        moment, ego = self.truth.moment(frame), frame.ego_pose
        away = np.hypot(frame.lon_m - ego.lon_m, frame.lat_m - ego.lat_m)
        fraction, occluder, _ = visibility_of(frame, road, ego, away <= self.settings.range_m, self.settings.range_m)
        in_range = moment.counts & (away <= self.settings.range_m)
        sight = sight_to(moment.given.x_m, moment.given.y_m, road, ego, moment.given.heading_rad)
        reached = in_reach(self.settings, sight.distance, np.zeros(len(sight.distance)))
        given, origin = moment.given.take(reached), moment.origin[reached]
        detections = self._detections(given, road, ego)
        if moment.drawn:
            detections = _with_errors(detections, self.settings.class_accuracy, rng)
        known = origin != NOTHING
        return Observation(
            scan=Scan(frame.time_s, detections, ego, own_shadows(self.settings, detections, ego, road)),
            truth_id=np.where(known, frame.vehicle_id[origin], ""),
            detection_visible_fraction=np.where(known, fraction[origin], np.nan),
            visible_fraction=fraction,
            occluder=occluder,
            in_range=in_range,
            state=np.select([~in_range, moment.unseen, moment.covered], [OUT, HIDDEN, PARTIAL], default=VISIBLE).astype(
                np.int8
            ),
        )

    def _detections(self, given: GivenBoxes, road: Road, ego: EgoPose) -> Detections:
        settings, count = self.settings, len(given)
        sight = sight_to(given.x_m, given.y_m, road, ego, given.heading_rad)
        std = position_std(settings, sight.distance, sight.against_axis, np.ones(count), given.heading_rad)
        unknown = np.full(count, np.nan)
        sizes = None
        if settings.std_length_m is not None and settings.std_width_m is not None:
            length, width = (np.maximum(rounded(column), SMALLEST_BOX_M) for column in (given.length_m, given.width_m))
            deviations = np.full(count, settings.std_length_m), np.full(count, settings.std_width_m)
            sizes = BodySizes(length, width, *deviations)
        place = rounded(given.x_m), rounded(given.y_m)
        std_lon, std_lat = rounded(std.lon_m), rounded(std.lat_m)
        deviation, flipped = np.full(count, STD_HEADING_RAD), np.full(count, FLIP_PROBABILITY)
        headings = BodyHeadings(rounded(given.heading_rad), deviation, flipped)
        score = None if self.scores is None else as_score((given.score - self.scores[0]) / self.scores[1])
        measured = *place, unknown, std_lon, std_lat, unknown.copy()
        return Detections(*measured, sizes, headings, score=score, vehicle_class=given.vehicle_class)


def _with_errors(exact: Detections, class_accuracy: float, rng: np.random.Generator) -> Detections:
    """Return detections that are off by as much as they say; without classes where the accuracy is 0."""
    count, sizes, headings = len(exact), exact.sizes, exact.headings
    normals = rng.standard_normal((5, count))
    lon_m = rounded(exact.lon_m + normals[0] * exact.std_lon_m)
    lat_m = rounded(exact.lat_m + normals[1] * exact.std_lat_m)
    if sizes is not None:
        length_m = np.maximum(rounded(sizes.length_m + normals[2] * sizes.std_length_m), SMALLEST_BOX_M)
        width_m = np.maximum(rounded(sizes.width_m + normals[3] * sizes.std_width_m), SMALLEST_BOX_M)
        sizes = replace(sizes, length_m=length_m, width_m=width_m)
    if headings is not None:
        headings = replace(headings, heading_rad=rounded(headings.heading_rad + normals[4] * headings.std_rad))
    kind = exact.vehicle_class if class_accuracy else None
    kind = None if kind is None else confused(kind, class_accuracy, rng)
    return replace(exact, lon_m=lon_m, lat_m=lat_m, sizes=sizes, headings=headings, vehicle_class=kind)
