"""How well the visible part predicts lidar returns: ``python -m harness.lab.fit.lidar_view LOGS``.

``LOGS`` is a folder of Argoverse 2 logs, whose cuboids say whether three points of the raw lidar fell into them. The
area under the curve (AUC) is the chance that a vehicle that was met ranks above one that was not: by the visible
fraction from above, which the sensor uses; by the angle of the part that is seen; and by the points that are to be
expected, that angle times the height's, which falls with the distance. Nothing is fitted.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.stats import rankdata

from harness.common.markdown import markdown_table
from harness.sensor.visibility import compile_kernels, visible_fractions
from harness.truth.recorded.detected.av2 import read_av2
from harness.truth.recorded.detected.recorded_drive import Drive
from mmpf.numerics.arrays import BoolArray, FloatArray

RINGS_M = ((0.0, 30.0), (30.0, 60.0), (0.0, 60.0), (60.0, 100.0))
KINDS = ("visible fraction", "seen angle", "expected points")


def area_under_curve(value: FloatArray, met: BoolArray) -> float:
    """Return the probability that a value of those met exceeds one of the others, ties counting half (Mann-Whitney).

    Args:
        value: Values, shape (n,).
        met: Whose they are, shape (n,); nan where all are alike.
    """
    true, false = int(met.sum()), int((~met).sum())
    above = float(rankdata(value)[met].sum()) - true * (true + 1) / 2
    return above / (true * false) if true and false else float("nan")


def _of_drive(drive: Drive) -> Iterator[FloatArray]:
    """Yield for each step rows of distance, whether the lidar met it and the three values, shape (5, n)."""
    for step in range(len(drive.ego)):
        labels = drive.labels.take(drive.labels.step == step)
        place = drive.ego.x_m[step], drive.ego.y_m[step]
        body = np.stack([labels.x_m, labels.y_m, labels.heading_rad, labels.length_m, labels.width_m])
        fraction, _, _ = visible_fractions(place, body, np.zeros((5, 0)))
        away_m = np.hypot(labels.x_m - place[0], labels.y_m - place[1])
        slant = labels.heading_rad - np.arctan2(labels.y_m - place[1], labels.x_m - place[0])
        across_m = labels.length_m * np.abs(np.sin(slant)) + labels.width_m * np.abs(np.cos(slant))
        angle = fraction * across_m / away_m
        yield np.stack([away_m, ~labels.covered, fraction, angle, angle / away_m])[:, labels.counts]


def main(logs: Path) -> str:
    """Return the table of areas by distance, as Markdown."""
    compile_kernels()
    away_m, met, *values = np.concatenate([each for drive in read_av2(logs) for each in _of_drive(drive)], axis=1)
    rows = []
    for nearest, farthest in RINGS_M:
        inside = (away_m >= nearest) & (away_m < farthest)
        hits = met[inside] > 0.0
        areas = [f"{area_under_curve(value[inside], hits):.3f}" for value in values]
        rows.append([f"{nearest:g} to {farthest:g} m", str(inside.sum()), f"{100 * hits.mean():.0f}", *areas])
    return "\n".join(markdown_table(["distance", "vehicle-steps", "met, %", *KINDS], rows))


if __name__ == "__main__":
    print(main(Path(sys.argv[1])))  # noqa: T201
