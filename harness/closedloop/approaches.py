"""Finds cars that can be the ego of a ``cross`` episode: they approach a crossing where a hidden car has priority."""

import numpy as np

from harness.closedloop.beliefs import ego_of, true_bodies
from harness.closedloop.routes import LaneRoute, edge_of
from harness.closedloop.sight import SEEN_OFTEN, is_hidden, moments_in_sight
from harness.closedloop.traffic import LiveTraffic, row_of, with_ego
from harness.config.sensor import SensorSettings
from harness.decisions.crossings import Conflict, LaneChain, crossings_of, yields_on
from harness.decisions.yielding import EgoPath, meets, on_route, room_before, windows_of
from harness.truth.frame import Frame
from mmpf.map.lane_graph import LaneGraph

SOON_S = 5.0
"""An ego that would be at the stop line later is not coming up to it yet."""
NOBODY = "", False


def hidden_with_right_of_way(
    traffic: LiveTraffic, row: int, route: LaneRoute, settings: SensorSettings
) -> tuple[str, bool]:
    """Return a hidden car that the ego of a row, near its path, must let pass, and whether it had been in sight.

    Both would be at the place of conflict within the margin if the one went on as it would on a free road, and the
    other as fast as now. The name is empty if there is none; one not in sight often enough to be known of never was.
    """
    road, frames, graph = traffic.network.road, tuple(traffic.frames), route.graph
    ego = str(frames[-1].vehicle_id[row])
    now = with_ego(frames[-1], ego, frames[-1].step, traffic.step_s)
    lanes = LaneChain.of(graph, route.lanes)
    course, yields = EgoPath.of(lanes, ego_of(now)), yields_on(graph, lanes)
    if not yields or not _comes_up_first(course, float(lanes.begins_m[yields[0][0]]), now):
        return NOBODY
    for conflict in (conflict for crossing in crossings_of(graph, lanes)[:1] for conflict in crossing.conflicts):
        for name in _meeting(course, conflict, now):
            if not _in_range(now, name, settings) or not is_hidden(now, ego, name, road, settings):
                continue
            seen = moments_in_sight(frames, ego, name, road, settings)
            if _takes(traffic, graph, name, conflict) and (seen == 0 or seen >= SEEN_OFTEN):
                return name, seen > 0
    return NOBODY


def _comes_up_first(course: EgoPath, stop_m: float, now: Frame) -> bool:
    """Return whether the ego reaches a stop line soon, can still stop there, and has no vehicle before it."""
    if course.window((stop_m, stop_m))[0] > SOON_S or room_before(course, (stop_m,)) is None:
        return False
    _, along_m, _ = on_route(course.route, true_bodies(now))
    return not ((along_m > course.along_m) & (along_m < stop_m)).any()


def _meeting(course: EgoPath, conflict: Conflict, now: Frame) -> list[str]:
    """Return which vehicles would be at a conflict point at the same time as the ego at its present speed."""
    bodies, names = true_bodies(now), np.delete(now.vehicle_id, now.ego)
    on, along_m, speed_mps = on_route(conflict.route, bodies)
    windows = windows_of(conflict.other_m, along_m, speed_mps, bodies.length_m[on], speed_mps)
    return [str(name) for name in names[on][meets(course, conflict, windows, speed_mps)]]


def _in_range(now: Frame, name: str, settings: SensorSettings) -> bool:
    row = row_of(now, name)
    away_m = np.hypot(now.lon_m[row] - now.lon_m[now.ego], now.lat_m[row] - now.lat_m[now.ego])
    return bool(away_m <= settings.range_m)


def _takes(traffic: LiveTraffic, graph: LaneGraph, name: str, conflict: Conflict) -> bool:
    """Return whether a vehicle takes the route that has right of way."""
    edges = [edge_of(graph, lane) for lane in conflict.route.lanes if not graph.in_junction[lane]]
    last = int(conflict.route.lanes[-1])
    follow = graph.successor[graph.first_successor[last] : graph.first_successor[last + 1]].tolist()
    route = list(traffic.running.sumo.vehicle.getRoute(name))
    at = route.index(edges[-1]) if edges and edges[-1] in route else len(route)
    return at + 1 < len(route) and route[at + 1] in {edge_of(graph, lane) for lane in follow}
