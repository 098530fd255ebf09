"""False detections: those that flash up once, and those of false objects that stay for a while."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from harness.config.sensor import SensorSettings
from harness.sensor.lanearea import drawn_on_lanes, lanes_over, pieces_within
from harness.sensor.memory import Ghosts
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from harness.truth.frame import Frame
from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, FloatArray, joined, taken
from mmpf.scan import EgoPose

GHOST_LENGTH_STD_M, GHOST_WIDTH_STD_M, SMALLEST_GHOST_M = 0.5, 0.15, 0.5

InReach = Callable[[FloatArray, FloatArray], BoolArray]


def positions_on_lanes(
    settings: SensorSettings, road: Road, ego: EgoPose, count: int, rng: np.random.Generator, in_reach: InReach
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw positions evenly over the lanes in reach, by rejection.

    Args:
        settings: The sensor's figures.
        road: The lanes.
        ego: Pose of the sensor.
        count: How many.
        rng: Source of randomness.
        in_reach: Whether positions are, each of shape (k,), longitudinal first.

    Returns:
        Longitudinal and lateral positions, and the lanes' directions against the frame's axis, each of shape (count,);
        fewer where next to no lane is in reach.
    """
    if road.graph is not None:
        return _positions_on_graph(settings, road.graph, ego, count, rng, in_reach)
    lon, lat = _positions_on_road(settings, road, ego, count, rng, in_reach)
    return lon, lat, np.zeros(len(lon))


def on_a_lane(road: Road, lon_m: FloatArray, lat_m: FloatArray) -> BoolArray:
    """Return whether positions are on a lane, each of shape (n,)."""
    if road.graph is not None:
        return lanes_over(road.graph, lon_m, lat_m) > 0
    return np.asarray(road.lane_number_at(lon_m, lat_m) > 0)


def _positions_on_graph(
    settings: SensorSettings, graph: LaneGraph, ego: EgoPose, count: int, rng: np.random.Generator, in_reach: InReach
) -> tuple[FloatArray, FloatArray, FloatArray]:
    pieces = pieces_within(graph, ego.lon_m, ego.lat_m, settings.range_m)
    kept = np.zeros((0, 3))
    for _ in range(100):
        if len(kept) >= count or not len(pieces):
            break
        x, y, heading, even = drawn_on_lanes(graph, pieces, max(16, 4 * count), rng)
        kept = np.concatenate([kept, np.stack([x, y, heading], axis=-1)[even & in_reach(x, y)]])
    return kept[:count, 0], kept[:count, 1], kept[:count, 2]


def _positions_on_road(
    settings: SensorSettings, road: Road, ego: EgoPose, count: int, rng: np.random.Generator, in_reach: InReach
) -> tuple[FloatArray, FloatArray]:
    _, right, left, start, end = road.lane_table.T
    start = np.maximum(start, ego.lon_m - settings.range_m)
    end = np.minimum(end, ego.lon_m + settings.range_m)
    area = np.maximum(end - start, 0.0) * (left - right)
    kept = np.zeros((0, 2))
    # Where next to no lane is in reach the drawing ends with fewer positions rather than never.
    for _ in range(100):
        if len(kept) >= count or area.sum() <= 0.0:
            break
        lane = rng.choice(len(area), size=max(16, 2 * count), p=area / area.sum())
        lon = rng.uniform(start[lane], np.maximum(start, end)[lane])
        lat = rng.uniform(right[lane], left[lane])
        kept = np.concatenate([kept, np.stack([lon, lat], axis=-1)[in_reach(lon, lat)]])
    return kept[:count, 0], kept[:count, 1]


def ghosts_after(
    settings: SensorSettings,
    before: Ghosts | None,
    frame: Frame,
    road: Road,
    step_s: float,
    rng: np.random.Generator,
) -> Ghosts:
    """Return the false objects a step later: some are gone, some are new, those that move have moved.

    Their number around the ego is Poisson with the asked-for mean at all times and their lives are exponential. One
    that the ego leaves behind comes in again as another at the opposite end of the range, in the plane anywhere on the
    lanes in range, so that driving past them makes them no rarer.

    Args:
        settings: The sensor's figures.
        before: The false objects a step ago; None at the first.
        frame: The traffic, with which some move.
        road: The lanes.
        step_s: Time since the step before.
        rng: Source of randomness.
    """
    ego = frame.ego_pose
    if before is None:
        return _new(settings, int(rng.poisson(settings.persistent_clutter)), frame, road, rng)
    kept = np.exp(-step_s / settings.persistent_clutter_s)
    stays = rng.random(len(before)) < kept
    born = _new(settings, int(rng.poisson(settings.persistent_clutter * (1.0 - kept))), frame, road, rng)
    moved = _moved(before, road, step_s)
    columns = {
        column.name: np.concatenate([getattr(moved, column.name)[stays], getattr(born, column.name)])
        for column in fields(Ghosts)
    }
    around = Ghosts(**columns)
    reach = settings.range_m
    if road.graph is not None:
        away = np.hypot(around.lon_m - ego.lon_m, around.lat_m - ego.lat_m)
        left_behind = np.flatnonzero(away > reach)
        others = _new(settings, len(left_behind), frame, road, rng)
        return joined(taken(around, np.flatnonzero(away <= reach)), others)
    return replace(around, lon_m=ego.lon_m + (around.lon_m - ego.lon_m + reach) % (2.0 * reach) - reach)


def _moved(ghosts: Ghosts, road: Road, step_s: float) -> Ghosts:
    """Return the false objects a step later, on a graph along the lanes that lead their way and straight off these."""
    way_m = ghosts.speed_mps * step_s
    if road.graph is None:
        return replace(ghosts, lon_m=ghosts.lon_m + way_m)
    lane = road.graph.lane_at(ghosts.lon_m, ghosts.lat_m, ghosts.axis_rad)
    along, left, _ = road.graph.on_lane(lane, ghosts.lon_m, ghosts.lat_m)
    x, y, heading = road.graph.place(lane, along + way_m, left)
    straight_x = ghosts.lon_m + way_m * np.cos(ghosts.axis_rad)
    straight_y = ghosts.lat_m + way_m * np.sin(ghosts.axis_rad)
    moves = (lane != NOWHERE) & (way_m > 0.0)
    return replace(
        ghosts,
        lon_m=np.where(moves, x, straight_x),
        lat_m=np.where(moves, y, straight_y),
        axis_rad=np.where(moves, heading, ghosts.axis_rad),
    )


def _new(settings: SensorSettings, count: int, frame: Frame, road: Road, rng: np.random.Generator) -> Ghosts:
    """Draw false objects evenly over the lanes around the ego, all round whatever the field of view."""
    ego = frame.ego_pose

    def all_round(lon_m: FloatArray, lat_m: FloatArray) -> BoolArray:
        within = np.hypot(lon_m - ego.lon_m, lat_m - ego.lat_m) <= settings.range_m
        return np.asarray(within) if road.graph is not None else np.ones(len(lon_m), dtype=np.bool_)

    lon, lat, axis = positions_on_lanes(settings, road, ego, count, rng, all_round)
    count = len(lon)
    moves = rng.random(count) < settings.persistent_clutter_moving
    others = np.flatnonzero(np.arange(len(frame)) != frame.ego)
    like = rng.random(count)
    speed = np.zeros(count)
    if len(others):
        speed = frame.speed_mps[others][(like * len(others)).astype(np.int64)]
    normals = rng.standard_normal((count, 2))
    return Ghosts(
        lon_m=lon,
        lat_m=lat,
        axis_rad=axis,
        speed_mps=np.where(moves, speed, 0.0),
        length_m=np.maximum(NOMINAL_LENGTH_M + GHOST_LENGTH_STD_M * normals[:, 0], SMALLEST_GHOST_M),
        width_m=np.maximum(NOMINAL_WIDTH_M + GHOST_WIDTH_STD_M * normals[:, 1], SMALLEST_GHOST_M),
    )
