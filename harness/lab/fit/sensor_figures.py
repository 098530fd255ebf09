"""What real detectors found of labelled vehicles, as figures of a sensor: fitted, drawn again, and held together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, differential_evolution, minimize

from harness.config.sensor import SensorSettings
from harness.lab.fit.sensor_records import LINKED_STEPS, FalseObjects, Looks, false_objects_of, gap_steps, looks_of
from harness.sensor.failings import detection_probability, miss_chain
from harness.sensor.memory import Chain, next_state
from harness.truth.frame import STEP_S
from harness.truth.recorded.detected.drive import Drive
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, taken

RANGE_M = 80.0
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
