"""False detections: those that flash up once, and those of false objects that stay for a while."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from harness.config.sensor import SensorSettings
from harness.sensor.memory import Ghosts
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from harness.truth.frame import Frame
from mmpf.map.road import Road
from mmpf.numerics.arrays import joined, taken

GHOST_LENGTH_STD_M, GHOST_WIDTH_STD_M, SMALLEST_GHOST_M = 0.5, 0.15, 0.5


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
    lon_m, lat_m, axis_rad = road.moved(before.lon_m, before.lat_m, before.axis_rad, before.speed_mps * step_s)
    moved = replace(before, lon_m=lon_m, lat_m=lat_m, axis_rad=axis_rad)
    columns = {
        column.name: np.concatenate([getattr(moved, column.name)[stays], getattr(born, column.name)])
        for column in fields(Ghosts)
    }
    around = Ghosts(**columns)
    lon_m, stays = road.come_round(around.lon_m, around.lat_m, (ego.lon_m, ego.lat_m), settings.range_m)
    others = _new(settings, int((~stays).sum()), frame, road, rng)
    return joined(taken(replace(around, lon_m=lon_m), np.flatnonzero(stays)), others)


def _new(settings: SensorSettings, count: int, frame: Frame, road: Road, rng: np.random.Generator) -> Ghosts:
    """Draw false objects evenly over the lanes around the ego, all round whatever the field of view."""
    ego = frame.ego_pose
    lon, lat, axis = road.draw_on_lanes(count, (ego.lon_m, ego.lat_m), settings.range_m, rng)
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
