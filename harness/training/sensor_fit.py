"""Fits a lidar's figures to what real detectors found of labelled vehicles, and says how well they fit.

    python -m harness.training.sensor_fit --kitti KITTI --v2v4real V2V4REAL/train --held-out-v2v4real V2V4REAL/val

Folders are laid out as docs/evidence.md says; none of their data is kept. What is fitted is the profile ``lidar-real``:
detection by visible fraction and range (maximum likelihood), runs of misses and lives of false objects (least
Kolmogorov-Smirnov distance of the lengths that the sensor's own chains draw on the same labels), and errors of boxes.
KITTI's sequences of AB3DMOT's validation split and the other V2V4Real folder are held out.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import Bounds, differential_evolution, minimize

from harness.errors import InputError
from harness.sensor.failings import detection_probability, miss_chain
from harness.sensor.memory import Chain, next_state
from harness.sensor.settings import SensorSettings
from harness.training.sensor_records import (
    LINKED_STEPS,
    FalseObjects,
    Looks,
    false_objects_of,
    gap_steps,
    looks_of,
    seen_at_all,
)
from harness.truth.frame import STEP_S
from harness.truth.recorded.detected.av2 import read_av2
from harness.truth.recorded.detected.drive import Drive
from harness.truth.recorded.detected.kitti import read_kitti
from harness.truth.recorded.detected.v2v4real import read_v2v4real
from harness.writing.markdown import markdown_table
from mmpf.compute.arrays import BoolArray, FloatArray, IntArray, taken

FIRST_TRAINING_SEED = 1000
RETURNS_WITHIN_M = (30.0, 50.0, 80.0, 150.0)
RANGE_M = 80.0
KITTI_HELD_OUT = ("0001", "0006", "0008", "0010", "0012", "0013", "0014", "0015", "0016", "0018", "0019")
KITTI_LEAST_SCORE, V2V4REAL_LEAST_SCORE = 2.0, 0.2
# Detections of vehicles that geometry calls hidden are not impossible: labels and heights are not exact.
LEAST_PROBABILITY = 0.02
PLAIN_VIEW_WITHIN_M = 40.0
SIMULATED_OBJECTS = 4000
LONGEST_LAG = 15
# Runs of misses are fitted to one in so many vehicles.
EVERY = 2


@dataclass(frozen=True)
class Records:
    """What was found on some drives: of vehicles, of nothing, and in how many scans."""

    looks: Looks
    false_objects: FalseObjects
    scans: int


def records_of(drives: Sequence[Drive]) -> Records:
    """Return the records of some drives."""
    return Records(looks_of(drives, RANGE_M), false_objects_of(drives), sum(len(drive.ego) for drive in drives))


def fit_detection(looks: Looks, settings: SensorSettings) -> SensorSettings:
    """Return a sensor whose detection by visible fraction and range is the likeliest."""

    def at(values: FloatArray) -> SensorSettings:
        top, exponent, far, full = 1.0 / (1.0 + np.exp(-values))
        figures = {"detection_probability": top, "view_exponent": exponent, "missed_far_share": min(far, 0.9)}
        return settings.model_copy(update={**figures, "full_view_fraction": 0.2 + 0.8 * full})

    def loss(values: FloatArray) -> float:
        probability = np.clip(chances(at(values), looks), LEAST_PROBABILITY, 1.0 - 1e-6)
        return -float(np.where(looks.found, np.log(probability), np.log1p(-probability)).mean())

    found = minimize(loss, np.array([2.0, -0.5, -1.0, 0.0]), method="Nelder-Mead", options={"maxiter": 400})
    return at(found.x)


def chances(settings: SensorSettings, looks: Looks) -> FloatArray:
    """Return the detection probability of each look, shape (n,)."""
    everybody = np.ones(len(looks), dtype=np.bool_)
    return detection_probability(settings, looks.distance_m, looks.fraction, everybody)


def drawn(settings: SensorSettings, looks: Looks, seed: int) -> BoolArray:
    """Return which looks the sensor finds if it looks at the same labels, shape (n,)."""
    rng = np.random.default_rng(seed)
    age = np.arange(len(looks)) - np.flatnonzero(np.diff(looks.vehicle, prepend=-1))[_ranks(looks.vehicle)]
    probability = chances(settings, looks)
    chain = miss_chain(settings, probability, looks.fraction)
    bursts = Chain(settings.burst_share, settings.burst_s)
    order = np.argsort(age, kind="stable")
    ends = np.searchsorted(age[order], np.arange(int(age.max()) + 2))
    found = np.zeros(len(looks), dtype=np.bool_)
    missed, burst = np.full((2, len(looks)), np.nan)
    uniforms = rng.random((3, len(looks)))
    for k in range(int(age.max()) + 1):
        now = order[ends[k] : ends[k + 1]]
        before = np.full((2, len(now)), np.nan) if k == 0 else np.stack([missed[now - 1], burst[now - 1]])
        share, run_s = np.asarray(chain.share)[now], np.asarray(chain.run_s)[now]
        missed[now] = next_state(Chain(share, run_s), before[0], STEP_S, uniforms[0, now])
        burst[now] = next_state(bursts, before[1], STEP_S, uniforms[1, now])
        gone = (missed[now] > 0.0) | (burst[now] > 0.0)
        found[now] = (uniforms[2, now] < probability[now] / (1.0 - share)) & ~gone
    return found


def _ranks(vehicle: IntArray) -> IntArray:
    """Return the number of each look's vehicle, counted from 0 in their order, shape (n,)."""
    return np.cumsum(np.diff(vehicle, prepend=-1) != 0) - 1


def fit_runs(looks: Looks, settings: SensorSettings, seed: int) -> SensorSettings:
    """Return the sensor with runs of misses as long as those of the looks; bursts are the long ones of anybody."""
    looks = taken(looks, looks.vehicle % EVERY == 0)
    known = gap_steps(looks, looks.found)

    def at(values: FloatArray) -> SensorSettings:
        in_runs, run_s, hidden_s, burst_share, burst_s = values.tolist()
        # Bursts come on top, so that the rest of the misses are fewer.
        top = min(settings.detection_probability / (1.0 - burst_share), 0.999)
        runs = {"missed_in_runs": in_runs, "missed_run_s": run_s, "missed_run_hidden_s": max(hidden_s, run_s)}
        figures = {**runs, "burst_share": burst_share, "burst_s": burst_s, "detection_probability": top}
        return settings.model_copy(update=figures)

    def loss(values: FloatArray) -> float:
        lengths = gap_steps(looks, drawn(at(values), looks, seed))
        return distance(lengths, known)

    bounds = Bounds([0.0, 0.1, 0.1, 0.0, 0.3], [1.0, 1.0, 4.0, 0.15, 8.0])
    best = differential_evolution(loss, bounds, rng=seed, popsize=4, maxiter=5, polish=False, init="sobol")
    return at(best.x)


def distance(first: IntArray, second: IntArray) -> float:
    """Return the Kolmogorov-Smirnov distance of two samples of whole numbers."""
    if not len(first) or not len(second):
        return 1.0
    at = np.arange(max(int(first.max()), int(second.max())) + 1)
    shares = [np.searchsorted(np.sort(sample), at, side="right") / len(sample) for sample in (first, second)]
    return float(np.abs(shares[0] - shares[1]).max())


@dataclass(frozen=True)
class Ghostly:
    """How false objects come and go.

    Attributes:
        flashes: Share of chains that are a single false detection.
        life_s: Mean life of the others.
        probability: With which each of these is detected in a scan.
    """

    flashes: float
    life_s: float
    probability: float


def lives_drawn(ghosts: Ghostly, seed: int) -> IntArray:
    """Return lives of chains of false boxes as they are linked, steps."""
    rng = np.random.default_rng(seed)
    life = np.maximum(np.ceil(rng.exponential(ghosts.life_s / STEP_S, SIMULATED_OBJECTS)).astype(np.int64), 1)
    of = np.repeat(np.arange(len(life)), life)
    at = np.flatnonzero(rng.random(len(of)) < ghosts.probability)
    begins = np.ones(len(at), dtype=np.bool_)
    begins[1:] = (np.diff(of[at]) != 0) | (np.diff(at) > LINKED_STEPS)
    first = np.flatnonzero(begins)
    lives = at[np.append(first[1:], len(at)) - 1] - at[first] + 1
    flashes = round(len(lives) * ghosts.flashes / max(1.0 - ghosts.flashes, 1e-6))
    return np.concatenate([lives, np.ones(flashes, dtype=np.int64)])


def fit_ghosts(chains: FalseObjects, seed: int) -> Ghostly:
    """Return how false objects come and go so that chains live as long as those on record."""
    long = chains.life_steps >= 3
    inside = float((chains.boxes[long] - 2).sum() / (chains.life_steps[long] - 2).sum())
    tried = [
        Ghostly(flashes, life_s, inside)
        for flashes in np.arange(0.0, 0.9, 0.05).tolist()
        for life_s in (0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0)
    ]
    return min(tried, key=lambda ghosts: distance(lives_drawn(ghosts, seed), chains.life_steps))


def robust_std(values: FloatArray) -> float:
    """Return the standard deviation that the median of the absolute values of a normal law with mean 0 suggests."""
    return float(1.4826 * np.nanmedian(np.abs(values)))


def fit_errors(looks: Looks, settings: SensorSettings) -> SensorSettings:
    """Return the sensor with errors of boxes as those on record."""
    near = looks.found & (looks.distance_m < PLAIN_VIEW_WITHIN_M)
    plain = near & (looks.fraction >= settings.full_view_fraction)
    partly = near & (looks.fraction < 0.5 * settings.full_view_fraction)
    along, across = robust_std(looks.along_m[plain]), robust_std(looks.across_m[plain])
    ratio = 0.5 * (robust_std(looks.along_m[partly]) / along + robust_std(looks.across_m[partly]) / across)
    hidden = np.clip(
        (settings.full_view_fraction - looks.fraction[partly])
        / (settings.full_view_fraction - settings.hidden_fraction),
        0.0,
        1.0,
    ).mean()
    share, time_s = fit_drift(looks)
    return settings.model_copy(
        update={
            "std_lon_m": along,
            "std_lat_m": across,
            "std_length_m": robust_std(looks.longer_m[plain]),
            "std_width_m": robust_std(looks.wider_m[plain]),
            "hidden_noise_factor": max(1.0, 1.0 + (ratio - 1.0) / max(float(hidden), 0.1)),
            "bias_share": share,
            "bias_time_s": time_s,
        }
    )


def fit_drift(looks: Looks) -> tuple[float, float]:
    """Return which share of the errors' variance drifts, and its time constant, from how alike errors are over time."""
    limit = 4.0 * robust_std(looks.along_m)
    error = np.clip(looks.along_m, -limit, limit)
    variance = np.nanmean(error**2)
    lags = np.arange(1, LONGEST_LAG + 1)
    alike = []
    for lag in lags:
        same = looks.vehicle[lag:] == looks.vehicle[:-lag]
        alike.append(np.nanmean((error[lag:] * error[:-lag])[same]) / variance)
    tried = [
        (share, time_s) for share in np.arange(0.05, 1.0, 0.05) for time_s in (0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
    ]
    best = min(tried, key=lambda way: float(np.abs(way[0] * np.exp(-lags * STEP_S / way[1]) - alike).mean()))
    return float(best[0]), float(best[1])


def fitted(train: Records, all_round: Records, seed: int) -> tuple[SensorSettings, Ghostly]:
    """Return the sensor and its ghosts; how many false boxes there are is that of a sensor that looks all round."""
    settings = fit_detection(train.looks, SensorSettings(hidden_fraction=0.02, std_bearing_deg=0.05))
    settings = fit_runs(train.looks, settings, seed)
    settings = fit_errors(train.looks, settings)
    ghosts = fit_ghosts(train.false_objects, seed)
    chains = len(all_round.false_objects.boxes) / all_round.scans
    false_boxes = float(all_round.false_objects.boxes.sum()) / all_round.scans
    flashes = ghosts.flashes * chains
    figures = {
        "range_m": 100.0,
        "clutter_per_scan": flashes,
        "persistent_clutter": (false_boxes - flashes) / ghosts.probability,
        "persistent_clutter_s": ghosts.life_s,
        "persistent_clutter_probability": ghosts.probability,
    }
    return settings.model_copy(update=figures), ghosts


def area_under_curve(fraction: FloatArray, seen: BoolArray) -> float:
    """Return the probability that a seen vehicle's visible fraction is above an unseen one's, ties half."""
    order = np.sort(fraction[~seen])
    below = np.searchsorted(order, fraction[seen], side="left") + np.searchsorted(order, fraction[seen], side="right")
    return float(0.5 * below.mean() / len(order))


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
        prog="python -m harness.training.sensor_fit", description="Fit the profile lidar-real to detections on record."
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
