"""Fits the spread between vehicles of how often a real detector finds them in plain view.

    python -m harness.lab.fit.detectability_fit --kitti KITTI

The folder is laid out as docs/how-to/recording.md says; nothing of it is kept. Each labelled vehicle counts over its
frames that nobody covers (level 0 of KITTI's labels), within 60 m, if they are ten or more; misses in runs of a second
and longer are left out of them, which the sensor makes by other settings. The law of the detected frames is
beta-binomial, fitted by maximum likelihood: the mean and the spread of its beta distribution are the sensor's
``detectability_mean`` and ``detectability_spread``, with a share of 1 and a least factor of 0.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.stats import beta, betabinom

from harness.common.errors import InputError
from harness.common.markdown import markdown_table
from harness.truth.recorded.detected.kitti import read_kitti
from harness.truth.recorded.detected.origin import NOTHING, origins
from harness.truth.recorded.detected.recorded_drive import Drive
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

KITTI_HELD_OUT = ("0001", "0006", "0008", "0010", "0012", "0013", "0014", "0015", "0016", "0018", "0019")
KITTI_LEAST_SCORE = 2.0
WITHIN_M, LEAST_FRAMES, LONG_RUN_STEPS = 60.0, 10, 10
RECALLS = (0.3, 0.6, 0.75, 0.9)


@dataclass(frozen=True)
class Recalls:
    """Vehicles in plain view, struct of arrays of shape (n,).

    Attributes:
        frames: Frames of each.
        found: How many of them have a detection of it.
    """

    frames: IntArray
    found: IntArray

    def __len__(self) -> int:
        return len(self.frames)


def without_long_runs(found: BoolArray) -> BoolArray:
    """Return which frames are in no run of misses of a second or longer, shape (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[1], found.astype(np.int64), [1]])))
    kept = np.ones(len(found), dtype=np.bool_)
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        kept[begin:end] = end - begin < LONG_RUN_STEPS
    return kept


def recalls_of(drives: Sequence[Drive], *, long_runs: bool = False) -> Recalls:
    """Return each vehicle's recall in plain view over some drives, with or without misses in long runs."""
    rows: list[tuple[int, int]] = []
    for drive in drives:
        labels, ego = drive.labels, drive.ego
        is_found = np.zeros(len(labels), dtype=np.bool_)
        origin = origins(drive)
        is_found[origin[origin != NOTHING]] = True
        away = np.hypot(labels.x_m - ego.x_m[labels.step], labels.y_m - ego.y_m[labels.step])
        plain = labels.counts & ~labels.covered & (away <= WITHIN_M)
        for thing in np.unique(labels.thing[plain]).tolist():
            frames = np.flatnonzero(plain & (labels.thing == thing))
            found = is_found[frames[np.argsort(labels.step[frames])]]
            kept = np.ones_like(found) if long_runs else without_long_runs(found)
            if kept.sum() >= LEAST_FRAMES:
                rows.append((int(kept.sum()), int(found[kept].sum())))
    columns = np.array(rows, dtype=np.int64).reshape(-1, 2)
    return Recalls(columns[:, 0], columns[:, 1])


def fit_beta_binomial(recalls: Recalls) -> tuple[float, float]:
    """Return the two parameters of the likeliest beta-binomial law."""

    def loss(values: FloatArray) -> float:
        first, second = np.exp(values)
        return -float(np.sum(betabinom.logpmf(recalls.found, recalls.frames, first, second)))

    best = minimize(loss, np.array([1.0, 0.0]), method="Nelder-Mead")
    first, second = np.exp(best.x).tolist()
    return first, second


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m harness.lab.fit.detectability_fit",
        description="Fit sensor.detectability_* to detections on record.",
    )
    parser.add_argument(
        "--kitti", type=Path, required=True, help="KITTI tracking; docs/how-to/recording.md shows the folder"
    )
    chosen = parser.parse_args(arguments)
    try:
        drives = [drive.scored_above(KITTI_LEAST_SCORE) for drive in read_kitti(chosen.kitti)]
    except InputError as error:
        parser.error(str(error))
    train, held_out = (
        [drive for drive in drives if (drive.name in KITTI_HELD_OUT) == is_held_out] for is_held_out in (False, True)
    )
    sets = {
        "fitted on": recalls_of(train),
        "held out": recalls_of(held_out),
        "fitted on, long runs too": recalls_of(train, long_runs=True),
    }
    if any(len(recalls) < 2 for recalls in sets.values()):
        parser.error(f"--kitti {chosen.kitti}: give sequences to fit on and some of {', '.join(KITTI_HELD_OUT)}")
    first, second = fit_beta_binomial(sets["fitted on"])
    law = beta(first, second)
    lines = [
        f"beta-binomial: a = {first:.3g}, b = {second:.3g}",
        f"detectability_mean = {law.mean():.3g}",
        f"detectability_spread = {law.std():.3g}",
    ]
    heads = ["set", "vehicles", "found, %", *(f"below {100 * recall:.0f} %" for recall in RECALLS), "nats a vehicle"]
    rows = [[name, *_told(recalls), _nats(first, second, recalls)] for name, recalls in sets.items()]
    rows.append(
        ["the law", "", f"{100 * law.mean():.1f}", *(f"{100 * law.cdf(recall):.1f} %" for recall in RECALLS), ""]
    )
    sys.stdout.write("\n".join([*lines, *markdown_table(heads, rows)]) + "\n")


def _told(recalls: Recalls) -> list[str]:
    share = recalls.found / recalls.frames
    found = float(np.sum(recalls.found) / np.sum(recalls.frames))
    return [
        str(len(recalls)),
        f"{100 * found:.1f}",
        *(f"{100 * float(np.mean(share < recall)):.1f} %" for recall in RECALLS),
    ]


def _nats(first: float, second: float, recalls: Recalls) -> str:
    return f"{-float(np.mean(betabinom.logpmf(recalls.found, recalls.frames, first, second))):.2f}"


if __name__ == "__main__":
    main()
