"""The lanes of a run's road as ASAM OSI messages: lanes with centre lines, and lane boundaries.

Nothing is known of the paint. A line that bounds two lanes, which vehicles cross, is declared dashed, one at the road's
edge an edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_lane_pb2 import Lane as LaneMessage
from osi3.osi_lane_pb2 import LaneBoundary

from harness.export.lanes import NO_STRIP, DrivenLanes, LanePolyline
from mmpf.numerics.arrays import FloatArray, IntArray

LINE_WIDTH_M = 0.15


@dataclass(frozen=True)
class OsiLanes:
    """Lanes and boundaries with identifiers that no vehicle has, and what each message of ground truth has of them.

    The first lane's identifier is ``first_id``; the boundaries' come after the lanes'.
    """

    lanes: DrivenLanes
    first_id: int
    content: GroundTruth

    def assigned(self, lon_m: FloatArray, lat_m: FloatArray) -> IntArray:
        """Return the identifier of the lane at each position, shape (n,); -1 for none."""
        strip = self.lanes.strip_at(lon_m, lat_m)
        return np.where(strip == NO_STRIP, NO_STRIP, strip + self.first_id)

    def add_to(self, message: GroundTruth, of_host: int) -> None:
        """Put the lanes into a message; ``of_host`` is the identifier of the lane that the ego is on, -1 for none."""
        message.MergeFrom(self.content)
        if of_host != NO_STRIP:
            message.lane[of_host - self.first_id].classification.is_host_vehicle_lane = True


def osi_lanes(lanes: DrivenLanes, first_id: int) -> OsiLanes:
    """Return the lanes as messages whose identifiers begin with a number."""
    content = GroundTruth()
    first_line = first_id + len(lanes.strips)
    for number, strip in enumerate(lanes.strips):
        message = content.lane.add()
        message.id.value = first_id + number
        about = message.classification
        about.type, about.subtype = LaneMessage.Classification.TYPE_DRIVING, LaneMessage.Classification.SUBTYPE_NORMAL
        about.centerline_is_driving_direction = True
        middle = LanePolyline(strip.lane.centre_m, strip.lane.start_m, strip.lane.end_m)
        _add_points(about.centerline, middle.points(lanes.road))
        about.left_lane_boundary_id.add(value=first_line + strip.left)
        about.right_lane_boundary_id.add(value=first_line + strip.right)
        for other in strip.left_neighbours:
            about.left_adjacent_lane_id.add(value=first_id + other)
        for other in strip.right_neighbours:
            about.right_adjacent_lane_id.add(value=first_id + other)
    between = {strip.left for strip in lanes.strips if strip.left_neighbours}
    between |= {strip.right for strip in lanes.strips if strip.right_neighbours}
    for number, line in enumerate(lanes.lines):
        boundary = content.lane_boundary.add()
        boundary.id.value = first_line + number
        kind = "TYPE_DASHED_LINE" if number in between else "TYPE_ROAD_EDGE"
        boundary.classification.type = getattr(LaneBoundary.Classification, kind)
        for x, y in line.points(lanes.road).tolist():
            point = boundary.boundary_line.add(width=LINE_WIDTH_M)
            point.position.x, point.position.y, point.position.z = x, y, 0.0
    return OsiLanes(lanes, first_id, content)


def _add_points(line: Any, points: FloatArray) -> None:  # noqa: ANN401  messages have no types of their own
    for x, y in points.tolist():
        line.add(x=x, y=y, z=0.0)
