"""Fits a lidar's figures to what real detectors found of labelled vehicles, and says how well they fit.

    python -m harness.lab.fit.sensor_fit --kitti KITTI --v2v4real V2V4REAL/train --held-out-v2v4real V2V4REAL/val

Folders are laid out as docs/evidence.md says; none of their data is kept. What is fitted is the profile ``lidar-real``:
detection by visible fraction and range (maximum likelihood), runs of misses and lives of false objects (least
Kolmogorov-Smirnov distance of the lengths that the sensor's own chains draw on the same labels), and errors of boxes.
KITTI's sequences of AB3DMOT's validation split and the other V2V4Real folder are held out.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from harness.common.errors import InputError
from harness.common.markdown import markdown_table
from harness.config.sensor import SensorSettings
from harness.lab.fit.sensor_figures import (
    Ghostly,
    Records,
    area_under_curve,
    distance,
    drawn,
    fitted,
    lives_drawn,
    records_of,
)
from harness.lab.fit.sensor_records import gap_steps, seen_at_all
from harness.truth.recorded.detected.av2 import read_av2
from harness.truth.recorded.detected.kitti import read_kitti
from harness.truth.recorded.detected.v2v4real import read_v2v4real

FIRST_TRAINING_SEED = 1000
RETURNS_WITHIN_M = (30.0, 50.0, 80.0, 150.0)
KITTI_HELD_OUT = ("0001", "0006", "0008", "0010", "0012", "0013", "0014", "0015", "0016", "0018", "0019")
KITTI_LEAST_SCORE, V2V4REAL_LEAST_SCORE = 2.0, 0.2


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _fit_of(settings: SensorSettings, ghosts: Ghostly, records: Records, seed: int) -> list[str]:
    looks = records.looks
    found = drawn(settings, looks, seed)
    known, told = gap_steps(looks, looks.found), gap_steps(looks, found)
    lives = lives_drawn(ghosts, seed)
    return [
        str(len(looks)),
        f"{100 * looks.found.mean():.1f}",
        f"{100 * found.mean():.1f}",
        str(len(known)),
        f"{distance(told, known):.3f}",
        f"{distance(lives, records.false_objects.life_steps):.3f}",
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m harness.lab.fit.sensor_fit", description="Fit the profile lidar-real to detections on record."
    )
    parser.add_argument("--kitti", type=Path, required=True, help="KITTI tracking, laid out as docs/evidence.md says")
    parser.add_argument("--v2v4real", type=Path, required=True, help="V2V4Real, sequences to fit on")
    parser.add_argument("--held-out-v2v4real", type=Path, required=True, help="V2V4Real, sequences to judge on")
    parser.add_argument("--av2", type=Path, help="Argoverse 2: is the visible fraction that of real lidar returns?")
    parser.add_argument("--seed", type=int, default=1000, help="seed of what is drawn, from 1000 on")
    chosen = parser.parse_args(arguments)
    if chosen.seed < FIRST_TRAINING_SEED:
        parser.error(f"--seed {chosen.seed}: fits draw on seeds from {FIRST_TRAINING_SEED} on only")
    try:
        kitti = [drive.scored_above(KITTI_LEAST_SCORE) for drive in read_kitti(chosen.kitti)]
        all_round, others = (
            [drive.scored_above(V2V4REAL_LEAST_SCORE) for drive in read_v2v4real(folder)]
            for folder in (chosen.v2v4real, chosen.held_out_v2v4real)
        )
        logs = () if chosen.av2 is None else read_av2(chosen.av2)
    except InputError as error:
        parser.error(str(error))
    train, held_out = (
        [drive for drive in kitti if (drive.name in KITTI_HELD_OUT) == is_held_out] for is_held_out in (False, True)
    )
    if not train or not held_out:
        parser.error(f"--kitti {chosen.kitti}: give sequences to fit on and some of {', '.join(KITTI_HELD_OUT)}")
    records = {
        "all that was fitted on": records_of([*train, *all_round]),
        "V2V4Real, fitted on": records_of(all_round),
        "KITTI, fitted on": records_of(train),
        "KITTI, held out": records_of(held_out),
        "V2V4Real, held out": records_of(others),
        "both, held out": records_of([*held_out, *others]),
    }
    settings, ghosts = fitted(records["all that was fitted on"], records["V2V4Real, fitted on"], chosen.seed)
    for name, value in settings.model_dump(exclude_defaults=True).items():
        _say(f"{name} = {float(value):.3g}")
    heads = ["set", "labels", "found, %", "model finds, %", "gaps", "KS of gaps", "KS of false objects' lives"]
    rows = [[name, *_fit_of(settings, ghosts, each, chosen.seed + 1)] for name, each in records.items()]
    _say("\n".join(markdown_table(heads, rows)))
    if logs:
        triples = [seen_at_all(drive) for drive in logs]
        away_m, fraction, seen = (np.concatenate(column) for column in zip(*triples, strict=True))
        for within_m in RETURNS_WITHIN_M:
            near = away_m <= within_m
            area = area_under_curve(fraction[near], seen[near])
            _say(f"AUC of the visible fraction against returns from {near.sum()} cuboids in {within_m:g} m: {area:.3f}")


if __name__ == "__main__":
    main()
