"""A road frame from lanelets: a reference line along the main road, and lanes as strips beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from harness.truth.network.polyline import at_shares, length_of
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.road import Lane, Road
from mmpf.numerics.arrays import FloatArray

SAMPLE_M = 2.0
# The drawn lanelets kink where they were cut; the road does not.
SMOOTH_OVER_M = 30.0
STRAIGHT_WITHIN_M = 0.05
# A lanelet that drifts by more than this across the road is a ramp: only its part beside the road is a lane.
RAMP_DRIFT_M = 1.8
SHORTEST_LANE_M = 10.0
SAME_LANE_WITHIN_M = 1.5
SHARED_LINE_WITHIN_M = 1.0
# Lanes that reach this near to where the map was cut go on beyond it, as the road does.
CUT_WITHIN_M = 15.0
BEYOND_MAP_M = 1000.0

# Right line, left line, and the pieces along the road of strips that lie behind one another.
_LaneFile = tuple[float, float, list[tuple[float, float]]]


@dataclass(frozen=True)
class Lanelet:
    """A piece of a lane.

    Attributes:
        left_xy: Left line in driving direction, shape (k, 2).
        right_xy: Right line, shape (m, 2).
        signals: Traffic lights at its end.
        in_junction: Whether it leads across a junction, if the file says so.
    """

    name: str
    left_xy: FloatArray
    right_xy: FloatArray
    successors: tuple[str, ...] = ()
    left: str | None = None
    right: str | None = None
    speed_limit_mps: float | None = None
    kinds: tuple[str, ...] = ()
    gives_way: bool = False
    signals: tuple[str, ...] = ()
    in_junction: bool | None = None

    def centre_xy(self) -> FloatArray:
        """Return the middle line, a point every two metres, shape (n, 2)."""
        left, right = self.sampled()
        return 0.5 * (left + right)

    def sampled(self) -> tuple[FloatArray, FloatArray]:
        """Return points of the left and the right line beside each other, every two metres, each of shape (n, 2)."""
        shares = _even_shares(self.left_xy)
        return at_shares(self.left_xy, shares), at_shares(self.right_xy, shares)


def road_from_lanelets(lanelets: Sequence[Lanelet], x: FloatArray, y: FloatArray) -> CorridorRoad:
    """Lay the road frame along the lanelets that traffic drives on.

    The reference line is the smoothed middle of the longest chain of lanelets, of about equally long ones that in the
    middle of the traffic. Lanes are numbered from the left.

    Args:
        lanelets: The lanelets.
        x: Positions of the traffic, shape (n,).
        y: Likewise.

    Returns:
        The road; its section is the extent of the map.
    """
    trunk = _trunk(lanelets, np.column_stack([x, y]))
    smooth = shapely.LineString(_smoothed(at_shares(trunk, _even_shares(trunk))))
    # Only the points without which the line would move by more than 5 cm (Douglas and Peucker 1973).
    reference = shapely.get_coordinates(shapely.simplify(smooth, STRAIGHT_WITHIN_M))
    frame = CorridorRoad(lanes=(), reference_xy=tuple((float(px), float(py)) for px, py in reference))
    strips = [strip for lanelet in lanelets if (strip := _strip(lanelet, frame)) is not None]
    lanes = _lanes(strips)
    start_m, end_m = min(strip.start_m for strip in strips), max(strip.end_m for strip in strips)
    return replace(frame, lanes=lanes, section_m=(start_m, end_m))


def _trunk(lanelets: Sequence[Lanelet], traffic_xy: FloatArray) -> FloatArray:
    chains = _chains({lanelet.name: lanelet for lanelet in lanelets})
    lengths = np.array([length_of(chain) for chain in chains])
    sample = traffic_xy[:: max(1, len(traffic_xy) // 300)]
    nearest = [
        float(np.mean(np.min(np.hypot(*(sample[:, None, :] - chain[None, ::3, :]).transpose(2, 0, 1)), axis=1)))
        if length > 0.9 * lengths.max()
        else np.inf
        for chain, length in zip(chains, lengths, strict=True)
    ]
    return chains[int(np.argmin(nearest))]


def _chains(lanelets: Mapping[str, Lanelet]) -> list[FloatArray]:
    """Join each lanelet without a predecessor to those that follow it, going straight on where there is a choice."""
    led_to = {name for lanelet in lanelets.values() for name in lanelet.successors}
    heads = [lanelet for lanelet in lanelets.values() if lanelet.name not in led_to] or list(lanelets.values())
    chains = []
    for head in heads:
        visited, here = [head.name], head
        line = head.centre_xy()
        while following := [lanelets[n] for n in here.successors if n in lanelets and n not in visited]:
            direction = line[-1] - line[-2]
            here = max(following, key=lambda lanelet: _straightness(direction, lanelet.centre_xy()))
            visited.append(here.name)
            line = np.concatenate([line, here.centre_xy()])
        chains.append(line)
    return chains


def _straightness(direction: FloatArray, line: FloatArray) -> float:
    step = line[1] - line[0]
    return float(direction @ step / max(np.hypot(*direction) * np.hypot(*step), 1e-9))


def _even_shares(line: FloatArray) -> FloatArray:
    return np.linspace(0.0, 1.0, max(2, int(length_of(line) / SAMPLE_M) + 1))


def _smoothed(line: FloatArray) -> FloatArray:
    """Return a moving average; beyond its ends the line is extended straight."""
    reach = min(int(0.5 * SMOOTH_OVER_M / SAMPLE_M), (len(line) - 1) // 2)
    if reach < 1:
        return line
    before = 2.0 * line[0] - line[reach:0:-1]
    after = 2.0 * line[-1] - line[-2 : -reach - 2 : -1]
    padded = np.concatenate([before, line, after])
    weights = np.hanning(2 * reach + 3)[1:-1]
    weights /= weights.sum()
    return np.column_stack([np.convolve(padded[:, axis], weights, mode="valid") for axis in (0, 1)])


def _strip(lanelet: Lanelet, frame: Road) -> Lane | None:
    """Return a lanelet in the road frame, not numbered yet; None of one that leads back, or is a ramp."""
    left, right = lanelet.sampled()
    left_lon, left_lat = frame.to_road(left[:, 0], left[:, 1])
    right_lon, right_lat = frame.to_road(right[:, 0], right[:, 1])
    lon, lat = 0.5 * (left_lon + right_lon), 0.5 * (left_lat + right_lat)
    if lon[-1] <= lon[0]:
        return None
    if np.ptp(lat) > RAMP_DRIFT_M:
        joined = lat[0] if abs(lat[0]) < abs(lat[-1]) else lat[-1]
        beside = np.abs(lat - joined) <= 0.5 * RAMP_DRIFT_M
        lon, left_lat, right_lat = lon[beside], left_lat[beside], right_lat[beside]
        if np.ptp(lon) < SHORTEST_LANE_M:
            return None
    return Lane(0, float(np.median(right_lat)), float(np.median(left_lat)), float(lon.min()), float(lon.max()))


def _lanes(strips: Sequence[Lane]) -> tuple[Lane, ...]:
    files = _with_shared_lines(_files_of_strips(strips))
    first_m, last_m = min(strip.start_m for strip in strips), max(strip.end_m for strip in strips)
    lanes = []
    for number, (right_m, left_m, pieces) in enumerate(files, start=1):
        for start_m, end_m in pieces:
            begin = start_m - BEYOND_MAP_M if start_m < first_m + CUT_WITHIN_M else start_m
            end = end_m + BEYOND_MAP_M if end_m > last_m - CUT_WITHIN_M else end_m
            lanes.append(Lane(number, right_m, left_m, begin, end))
    return tuple(lanes)


def _files_of_strips(strips: Sequence[Lane]) -> list[_LaneFile]:
    """Group strips that lie behind one another, from left to right."""
    groups: list[list[Lane]] = []
    for strip in sorted(strips, key=lambda strip: -strip.centre_m):
        if groups and abs(np.mean([other.centre_m for other in groups[-1]]) - strip.centre_m) < SAME_LANE_WITHIN_M:
            groups[-1].append(strip)
        else:
            groups.append([strip])
    files: list[_LaneFile] = []
    for group in groups:
        length_m = [strip.end_m - strip.start_m for strip in group]
        right_m = float(np.average([strip.right_m for strip in group], weights=length_m))
        left_m = float(np.average([strip.left_m for strip in group], weights=length_m))
        files.append((right_m, left_m, _joined(group)))
    return files


def _joined(group: Sequence[Lane]) -> list[tuple[float, float]]:
    pieces: list[tuple[float, float]] = []
    for strip in sorted(group, key=lambda strip: strip.start_m):
        if pieces and strip.start_m <= pieces[-1][1] + CUT_WITHIN_M:
            pieces[-1] = (pieces[-1][0], max(pieces[-1][1], strip.end_m))
        else:
            pieces.append((strip.start_m, strip.end_m))
    return pieces


def _with_shared_lines(files: list[_LaneFile]) -> list[_LaneFile]:
    """Let neighbours meet in the middle of the gap or overlap between them."""
    shared = list(files)
    for k in range(len(shared) - 1):
        (right_m, left_m, pieces), (next_right_m, next_left_m, next_pieces) = shared[k], shared[k + 1]
        if abs(right_m - next_left_m) <= SHARED_LINE_WITHIN_M:
            line_m = 0.5 * (right_m + next_left_m)
            shared[k] = (line_m, left_m, pieces)
            shared[k + 1] = (next_right_m, line_m, next_pieces)
    return shared
