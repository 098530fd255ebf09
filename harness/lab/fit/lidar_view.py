"""How well the visible part predicts lidar returns: ``python -m harness.lab.fit.lidar_view LOGS``.

``LOGS`` is a folder of Argoverse 2 logs, whose cuboids say whether three points of the raw lidar fell into them. The
area under the curve (AUC) is the chance that a vehicle that was met ranks above one that was not: by the visible
fraction from above, which the sensor uses; by the points that are to be expected, the visible angle times that of the
height, which falls with the distance; and by the solid angle that is seen over the roofs of what stands before it.
Nothing is fitted.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow.feather
from sklearn.metrics import roc_auc_score

from harness.common.errors import InputError
from harness.common.markdown import markdown_table
from harness.sensor.visibility import visible_fractions
from harness.truth.recorded.detected.av2 import ANNOTATIONS, RECORDING_CAR, VEHICLES, WITH_EGO, argoverse_logs
from harness.truth.recorded.logs import heading_of
from mmpf.numerics.arrays import FloatArray, turned, wrapped

LIDAR_HEIGHT_M = 1.64
"""How high the lidars are above the origin of Argoverse 2's recording car."""
RAYS = 15
"""Directions in which each cuboid is looked at."""
FEWEST_POINTS = 3
RINGS_M = ((0.0, 30.0), (30.0, 60.0), (0.0, 60.0), (60.0, 100.0))
KINDS = ("visible fraction", "expected points", "solid angle")


def solid_angles(body: FloatArray, bottom_m: FloatArray, top_m: FloatArray) -> FloatArray:
    """Return how much of each cuboid is seen from the origin over the roofs of what stands before it, sr, shape (n,).

    Each direction in which a cuboid is looked at is cut by what it hits: of the cuboid, what lies above the highest
    roof before it is seen. What stands before it is taken to reach down to the ground.

    Args:
        body: x, y, heading, length and width, shape (5, n).
        bottom_m: Heights against the lidar's, shape (n,).
        top_m: Likewise.
    """
    place, heading_rad, half = body[:2], body[2], 0.5 * body[3:]
    away_m, bearing = np.hypot(*place), np.arctan2(*place[::-1])
    ahead = np.stack([np.cos(heading_rad), np.sin(heading_rad)])
    corners = [
        place + a * half[0] * ahead + b * half[1] * np.stack([-ahead[1], ahead[0]]) for a in (-1, 1) for b in (-1, 1)
    ]
    aside = wrapped(np.stack([np.arctan2(*corner[::-1]) for corner in corners]) - bearing)
    first, wide = aside.min(axis=0), np.ptp(aside, axis=0)
    ray = (bearing + first)[:, None] + wide[:, None] * (np.arange(RAYS) + 0.5) / RAYS
    # Distance along each ray, of shape (n, RAYS), to each cuboid: where it is between both pairs of its sides.
    start = np.stack(turned(-place[0], -place[1], heading_rad))
    way = np.stack(turned(np.cos(ray)[:, :, None], np.sin(ray)[:, :, None], heading_rad))
    way = np.where(way == 0.0, 1e-12, way)
    sides = np.stack([(side * half[:, None, None] - start[:, None, None]) / way for side in (-1.0, 1.0)])
    enters_m, leaves_m = sides.min(axis=0).max(axis=0), sides.max(axis=0).min(axis=0)
    own = np.arange(len(away_m))
    target_m = np.where(enters_m[own, :, own] > 0.0, enters_m[own, :, own], away_m[:, None])
    before = (enters_m <= leaves_m) & (enters_m > 0.0) & (enters_m < target_m[:, :, None])
    before[own, :, own] = False
    roof = np.where(before, top_m / np.maximum(enters_m, 0.5), -np.inf).max(axis=2)
    seen_from = np.maximum((bottom_m / away_m)[:, None], roof)
    return np.asarray(np.maximum((top_m / away_m)[:, None] - seen_from, 0.0).mean(axis=1) * wide)


def _of_log(log: Path) -> Iterator[FloatArray]:
    """Yield for each moment rows of distance, whether the lidar met it and the three values, shape (5, n)."""
    path = log / WITH_EGO if (log / WITH_EGO).exists() else log / ANNOTATIONS
    table = pyarrow.feather.read_table(path, memory_map=False).to_pandas()
    for _, rows in table[table["category"] != RECORDING_CAR].groupby("timestamp_ns"):
        x_m, y_m, z_m, length_m, width_m, height_m, points = (
            rows[name].to_numpy(dtype=np.float64)
            for name in ("tx_m", "ty_m", "tz_m", "length_m", "width_m", "height_m", "num_interior_pts")
        )
        heading = heading_of(rows[["qw", "qx", "qy", "qz"]].to_numpy(dtype=np.float64))
        low_m = z_m - 0.5 * height_m - LIDAR_HEIGHT_M
        body = np.stack([x_m, y_m, heading, length_m, width_m])
        fraction, _, _ = visible_fractions((0.0, 0.0), body, np.zeros((5, 0)))
        away_m, slant = np.hypot(x_m, y_m), heading - np.arctan2(y_m, x_m)
        across_m = length_m * np.abs(np.sin(slant)) + width_m * np.abs(np.cos(slant))
        solid = solid_angles(body, low_m, low_m + height_m)
        values = np.stack([away_m, points >= FEWEST_POINTS, fraction, fraction * across_m / away_m**2, solid])
        yield values[:, rows["category"].isin(list(VEHICLES)).to_numpy()]


def main(logs: Path) -> str:
    """Return the table of areas by distance, as Markdown."""
    if not (found := argoverse_logs(logs)):
        raise InputError(f"{logs} holds no logs of Argoverse 2; give a folder of them")
    away_m, met, *values = np.concatenate([each for log in found for each in _of_log(log)], axis=1)
    rows = []
    for nearest, farthest in RINGS_M:
        inside = (away_m >= nearest) & (away_m < farthest)
        hits = met[inside] > 0.0
        both = 0 < hits.sum() < len(hits)
        areas = [f"{roc_auc_score(hits, value[inside]):.3f}" if both else "nan" for value in values]
        rows.append([f"{nearest:g} to {farthest:g} m", str(inside.sum()), f"{100 * hits.mean():.0f}", *areas])
    return "\n".join(markdown_table(["distance", "vehicle-steps", "met, %", *KINDS], rows))


if __name__ == "__main__":
    print(main(Path(sys.argv[1])))  # noqa: T201
