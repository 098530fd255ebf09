"""Road and traffic around each particle on a lane graph: its lane's boundaries, leader and follower on its route."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments
from mmpf.map.lane_graph import NOWHERE, LaneColumns, LaneGraph
from mmpf.motion.lane_following import GATE, AroundOnGraph, guidance
from mmpf.motion.protocol import Neighbour
from mmpf.motion.state import ACCEL, LAT, LON, SPEED
from mmpf.motion.turning import road_speeds, turning_driver
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.numerics.kernels import kernel
from mmpf.scan import EgoPose
from mmpf.surroundings.neighbours import IN_THE_WAY, to_be_found
from mmpf.surroundings.right_of_way import OnLanes
from mmpf.surroundings.stop_lines import stop_at_lines

HORIZON_M = 120.0
NOBODY = -1


class LanePlaces(NamedTuple):
    """Vehicles on the lanes, struct of arrays over v vehicles.

    Attributes:
        lane: Lane of each, ``NOWHERE`` for one that is on none or does not count.
        along_m: Arc length along it.
        left_m: Offset from its middle.
        speed_mps: Speed.
        accel_mps2: Acceleration.
        length_m: Length.
        width_m: Width.
        order: Vehicles in the order of lanes and arc lengths.
        first: Where each lane's begin in that order, and the end of the last, shape (l + 1,).
        next_gap_m: From each lane's beginning to the middle of the first vehicle that is in the way there, on the lane
            or on those that follow, (l,).
        next_vehicle: That vehicle, ``NOBODY`` if there is none within 120 m, (l,).
    """

    lane: IntArray
    along_m: FloatArray
    left_m: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    length_m: FloatArray
    width_m: FloatArray
    order: IntArray
    first: IntArray
    next_gap_m: FloatArray
    next_vehicle: IntArray

    def on_lanes(self, seen: BoolArray) -> OnLanes:
        """Return where they are, with which of them were seen lately, shape (v,)."""
        return OnLanes(self.lane, self.along_m, self.speed_mps, self.length_m, seen)


def surroundings_on_graph(
    mixture: Mixture,
    moments: Moments,
    is_seen: BoolArray,
    ego: EgoPose,
    ego_accel_mps2: float,
    graph: LaneGraph,
    open_links: Callable[[OnLanes], FloatArray | None],
) -> AroundOnGraph:
    """Return what each particle knows of road and traffic, in its own lane's frame; see ``surroundings_of``.

    A link that a particle takes for closed is as a vehicle that stands at its stop line.

    Args:
        mixture: The belief; its confirmed components count as vehicles for the others.
        moments: Its components' moments.
        is_seen: Components that were seen lately, shape (m,).
        ego: Pose of the sensor's own vehicle, a neighbour like any other.
        ego_accel_mps2: Its acceleration.
        graph: The lanes.
        open_links: How probably each link can be taken now, (k,), given where vehicles are, or None where all can be.
    """
    cloud, vehicles = mixture.cloud, mixture.components
    placed = _placed(mixture, moments, ego, ego_accel_mps2, graph)
    lane, following = guidance(cloud.latents)
    along, left, _ = graph.on_lane(lane, cloud.state[LON], cloud.state[LAT])
    on_lane = lane != NOWHERE
    half = np.where(on_lane, 0.5 * graph.width_m[lane], np.nan)
    beside = [np.where(on_lane, column[lane], NOWHERE) for column in (graph.left, graph.right)]

    def found(of_lane: IntArray, sign: float, then: IntArray | None) -> Neighbour:
        """Return each particle's nearest vehicle ahead (sign 1) or behind (-1) on a lane, then on one that follows."""
        then = np.full(len(lane), NOWHERE) if then is None else then
        own, neighbour = (cloud.component, cloud.state[SPEED], lane, of_lane, along, left), to_be_found(len(lane))
        _find_nearest(placed, graph.length_m, *own, sign, then, neighbour)
        return neighbour

    leader = found(lane, 1.0, following)
    chance = open_links(placed.on_lanes(np.append(is_seen, True)))
    if chance is not None:
        own = cloud.state[SPEED], vehicles.length_m[cloud.component]
        stop_at_lines(chance, cloud.latents[GATE], lane, following, along, *own, graph.columns, leader)
    return AroundOnGraph(
        length_m=vehicles.length_m[cloud.component],
        lane_right_m=-half,
        lane_left_m=half,
        has_left_lane=beside[0] != NOWHERE,
        has_right_lane=beside[1] != NOWHERE,
        leader=leader,
        left_leader=found(beside[0], 1.0, None),
        left_follower=found(beside[0], -1.0, None),
        right_leader=found(beside[1], 1.0, None),
        right_follower=found(beside[1], -1.0, None),
        is_hidden=~is_seen[cloud.component],
        road_speed_mps=road_speeds(graph, lane, following, along, turning_driver()),
        along_m=along,
        left_m=left,
    )


def _placed(mixture: Mixture, moments: Moments, ego: EgoPose, ego_accel_mps2: float, graph: LaneGraph) -> LanePlaces:
    components, mean = mixture.components, moments.mean
    x, y = np.append(mean[LON], ego.lon_m), np.append(mean[LAT], ego.lat_m)
    lane = graph.lane_at(x, y, np.append(moments.heading_rad, ego.heading_rad))
    lane = np.where(np.append(components.confirmed, True), lane, NOWHERE)
    along, left, _ = graph.on_lane(lane, x, y)
    order = np.lexsort((along, lane))
    order = order[lane[order] != NOWHERE]
    lanes, width = np.arange(len(graph) + 1), np.append(components.width_m, ego.width_m)
    # What stands beside a lane is not in the way of those who drive in its middle.
    ahead = order[np.abs(left[order]) < IN_THE_WAY * width[order]]
    from_lane = np.searchsorted(lane[ahead], lanes)
    gap, vehicle = _first_ahead(ahead, from_lane, along, graph.columns)
    return LanePlaces(
        lane=lane,
        along_m=along,
        left_m=left,
        speed_mps=np.append(mean[SPEED], ego.speed_mps),
        accel_mps2=np.append(mean[ACCEL], ego_accel_mps2),
        length_m=np.append(components.length_m, ego.length_m),
        width_m=width,
        order=order,
        first=np.searchsorted(lane[order], lanes),
        next_gap_m=gap,
        next_vehicle=vehicle,
    )


@kernel()
def _first_ahead(
    order: IntArray, first: IntArray, along: FloatArray, graph: LaneColumns
) -> tuple[FloatArray, IntArray]:
    """Return for each lane how far from its beginning the first vehicle on it or beyond its end is, and which."""
    length, successor, first_successor = graph.length_m, graph.successor, graph.first_successor
    lanes = len(length)
    gap, vehicle = np.full(lanes, np.inf), np.full(lanes, NOBODY)
    for k in range(lanes):
        if first[k] < first[k + 1]:
            vehicle[k] = order[first[k]]
            gap[k] = along[vehicle[k]]
    changed = True
    while changed:
        changed = False
        for k in range(lanes):
            if first[k] < first[k + 1]:
                continue
            for s in range(first_successor[k], first_successor[k + 1]):
                away = length[k] + gap[successor[s]]
                if away < gap[k] - 1e-9 and away <= HORIZON_M:
                    gap[k], vehicle[k], changed = away, vehicle[successor[s]], True
    return gap, vehicle


@kernel()
def _find_nearest(
    placed: LanePlaces,
    lane_length: FloatArray,
    component: IntArray,
    own_speed: FloatArray,
    lane: IntArray,
    of_lane: IntArray,
    along: FloatArray,
    left: FloatArray,
    sign: float,
    then: IntArray,
    neighbour: Neighbour,
) -> None:
    _, place, beside, speed, accel, length, width, order, first, next_gap, next_vehicle = placed
    exists, gap, neighbour_speed, neighbour_accel, neighbour_length = neighbour
    for n in range(len(component)):
        own, looked, who, away = component[n], of_lane[n], NOBODY, np.inf
        if looked >= 0:
            at = along[n] * lane_length[looked] / lane_length[lane[n]]
            for k in range(first[looked], first[looked + 1]):
                other = order[k]
                ahead = sign * (place[other] - at)
                if other == own or ahead <= 0.0 or ahead >= away:
                    continue
                # Within one lane two can still pass each other.
                if looked == lane[n] and abs(beside[other] - left[n]) >= IN_THE_WAY * 0.5 * (width[own] + width[other]):
                    continue
                who, away = other, ahead
            if who == NOBODY and then[n] >= 0 and next_vehicle[then[n]] not in (NOBODY, own):
                away = lane_length[looked] - at + next_gap[then[n]]
                who = next_vehicle[then[n]] if away <= HORIZON_M else NOBODY
        exists[n] = who != NOBODY
        if who == NOBODY:
            gap[n], neighbour_speed[n], neighbour_accel[n] = np.inf, own_speed[n], 0.0
            neighbour_length[n] = length[own]
        else:
            gap[n] = away - 0.5 * (length[own] + length[who])
            neighbour_speed[n], neighbour_accel[n], neighbour_length[n] = speed[who], accel[who], length[who]
