"""False detections: those that flash up once, and those of false objects that stay for a while."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from harness.sensor.memory import Ghosts
from harness.sensor.profiles import SensorSettings
from harness.sensor.shadows import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from harness.truth.frame import Frame
from mmpf.compute.arrays import BoolArray, FloatArray
from mmpf.road import Road
from mmpf.scan import EgoPose

GHOST_LENGTH_STD_M, GHOST_WIDTH_STD_M, SMALLEST_GHOST_M = 0.5, 0.15, 0.5

InReach = Callable[[FloatArray, FloatArray], BoolArray]


def positions_on_road(
    settings: SensorSettings, road: Road, ego: EgoPose, count: int, rng: np.random.Generator, in_reach: InReach
) -> tuple[FloatArray, FloatArray]:
    """Draw positions evenly over the lanes in reach, by rejection from the lanes' strips around the ego.

    Args:
        settings: The sensor's figures.
        road: The lanes.
        ego: Pose of the sensor.
        count: How many.
        rng: Source of randomness.
        in_reach: Whether positions are, each of shape (k,), longitudinal first.

    Returns:
        Longitudinal and lateral positions, each of shape (count,); fewer where next to no lane is in reach.
    """
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
    that the ego leaves behind comes in again as another at the opposite end of the range, so that driving past them
    makes them no rarer.

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
    moved = replace(before, lon_m=before.lon_m + before.speed_mps * step_s)
    columns = {
        column.name: np.concatenate([getattr(moved, column.name)[stays], getattr(born, column.name)])
        for column in fields(Ghosts)
    }
    around = Ghosts(**columns)
    reach = settings.range_m
    return replace(around, lon_m=ego.lon_m + (around.lon_m - ego.lon_m + reach) % (2.0 * reach) - reach)


def _new(settings: SensorSettings, count: int, frame: Frame, road: Road, rng: np.random.Generator) -> Ghosts:
    """Draw false objects evenly over the lanes around the ego, all round whatever the field of view."""
    ego = frame.ego_pose
    lon, lat = positions_on_road(settings, road, ego, count, rng, lambda lon, _: np.abs(lon - ego.lon_m) >= 0.0)
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
        speed_mps=np.where(moves, speed, 0.0),
        length_m=np.maximum(NOMINAL_LENGTH_M + GHOST_LENGTH_STD_M * normals[:, 0], SMALLEST_GHOST_M),
        width_m=np.maximum(NOMINAL_WIDTH_M + GHOST_WIDTH_STD_M * normals[:, 1], SMALLEST_GHOST_M),
    )
