"""Fits all parts of the learned driver, and the empirical follower, to windows of recorded car following.

A model fitted to recorded states alone never sees its own mistakes, so closed-loop errors grow. Recovery labels perturb
the recorded state and ask for the acceleration that leads back to the recorded trajectory. Data as demonstrator
(Venkatraman, Hebert and Bagnell, AAAI 2015) does the same to the states that the fitted model itself reaches.
"""

from collections.abc import Callable

import numpy as np

from harness.lab.fit.mixture_em import fit_mixture
from harness.lab.windows.car_following import CarFollowing
from harness.truth.frame import STEP_S
from mmpf.motion.gmm.scaled import ScaledGmm
from mmpf.motion.learned.driver import DriverModel, FreeDriver
from mmpf.motion.learned.empirical import EmpiricalFollower
from mmpf.motion.learned.features import SMALLEST_GAP_M, log_headway, situation
from mmpf.motion.learned.follower import MixtureFollower
from mmpf.motion.learned.lane_keeping import LaneKeeper
from mmpf.motion.learned.short_driver import short_inputs
from mmpf.numerics.arrays import FloatArray, IntArray, taken

FOLLOWING_SAMPLES = 300_000
SHORT_SAMPLES = 1_200_000
ROLLOUTS = 2000
HABIT_COMPONENTS = 12
HABIT_SITUATIONS_PER_WINDOW = 5
STEADY_CLOSING_MPS = 1.5
STEADY_ACCEL_MPS2 = 0.7
ACCEL_BIAS_MPS2 = 0.012
# In sight, particles take up changes more often than drivers do; see LaneKeeper.seen_changes_per_s.
PROPOSED_CHANGES = 10.0


def fit_driver(
    windows: CarFollowing, changes_per_s: float, components: int, seed: int, progress: Callable[[str], None]
) -> tuple[DriverModel, MixtureFollower]:
    """Fit the learned driver; its follower is returned beside it.

    The follower's mixture is fitted to recovery samples, then once more with what it demonstrated itself. Windows
    without a leader are left out of it.
    """
    rng = np.random.default_rng(seed)
    led = windows.led
    habit = driver_habit(led)
    progress(f"fitting {components} components to {FOLLOWING_SAMPLES} samples of {len(led)} windows")
    samples = recovery_samples(led, habit, FOLLOWING_SAMPLES, rng)
    first = fit_mixture(*samples, components, seed)
    progress("adding the states that the fitted model reaches, and fitting again")
    demonstrated = demonstrated_samples(led, habit, first, ROLLOUTS, rng)
    x, y = (np.concatenate(both) for both in zip(samples, demonstrated, strict=True))
    following = fit_mixture(x, y, components, seed)
    window = np.tile(np.arange(len(led)), HABIT_SITUATIONS_PER_WINDOW)
    step = rng.integers(led.lon_m.shape[1], size=len(window))
    seen = situation(*(column[window, step] for column in situation_columns(led)))
    habits = fit_mixture(seen, habit[window, None], HABIT_COMPONENTS, seed)
    follower = MixtureFollower(following, habits, ACCEL_BIAS_MPS2)
    free = _fit_free(taken(windows, ~windows.has_leader))
    return DriverModel(follower, free, _fit_keeper(windows, changes_per_s)), follower


def short_samples(led: CarFollowing, most: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return so many samples, or all, of the inputs (n, 5) and outputs (n, 4) of the paper's short-term model."""
    distance = led.gap_m + led.leader.length_m
    now, then = slice(None, -1), slice(1, None)
    columns = (led.offset_m, distance, led.speed_mps, led.accel_mps2, led.leader.speed_mps)
    x = short_inputs(*(column[:, now].ravel() for column in columns))
    advance = np.diff(led.lon_m, axis=1).ravel()
    outputs = (led.offset_m[:, then], led.speed_mps[:, then], led.accel_mps2[:, then])
    offset, speed, accel = (column.ravel() for column in outputs)
    chosen = rng.choice(len(x), size=min(most, len(x)), replace=False)
    return x[chosen], np.stack([offset, advance, speed, accel], axis=1)[chosen]


def driver_habit(led: CarFollowing) -> FloatArray:
    """Return each window's driver's mean log time headway over all its windows' steady moments, shape (windows,)."""
    closing = np.abs(led.speed_mps - led.leader.speed_mps)
    steady = (closing < STEADY_CLOSING_MPS) & (np.abs(led.accel_mps2) < STEADY_ACCEL_MPS2)
    weight = steady + 1e-3
    drivers = int(led.vehicle.max()) + 1
    headway = log_headway(led.gap_m, led.speed_mps)
    total = np.bincount(led.vehicle, (weight * headway).sum(axis=1), drivers)
    norm = np.bincount(led.vehicle, weight.sum(axis=1), drivers)
    return np.asarray((total / np.maximum(norm, 1e-9))[led.vehicle])


def situation_columns(led: CarFollowing) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the inputs of a driver's situation, in the order of ``situation``, each (windows, steps)."""
    return led.gap_m, led.speed_mps, led.accel_mps2, led.leader.speed_mps, led.leader.accel_mps2


def _fit_free(free: CarFollowing) -> FreeDriver:
    """Fit by least squares; a driver's desired speed is its mean speed at the window's end."""
    settle = 20
    desired = free.speed_mps[:, -settle:].mean(axis=1)
    speed, accel = free.speed_mps[:, : -settle - 1], free.accel_mps2[:, : -settle - 1]
    change = np.diff(free.accel_mps2[:, :-settle], axis=1) / STEP_S
    missing = desired[:, None] - speed
    design = np.stack([missing.ravel(), -accel.ravel()], axis=1)
    (pull, lag), *_ = np.linalg.lstsq(design, change.ravel(), rcond=None)
    noise = np.std(change.ravel() - design @ np.array([pull, lag])) * STEP_S
    start_accel, gained = free.accel_mps2[:, 0], desired - free.speed_mps[:, 0]
    per_accel = float(start_accel @ gained / (start_accel @ start_accel))
    spread = float(np.std(gained - per_accel * start_accel))
    lag = float(np.clip(lag, 0.2, 1.0 / STEP_S))
    return FreeDriver(lag, float(np.clip(pull / lag, 0.05, 2.0)), float(noise), per_accel, spread)


def _fit_keeper(windows: CarFollowing, changes_per_s: float) -> LaneKeeper:
    """Fit the pull to each window's mean place in the lane by least squares; what is left is the noise."""
    place = windows.offset_m.mean(axis=1)
    away, lat_speed = windows.offset_m[:, :-1] - place[:, None], windows.lat_speed_mps[:, :-1]
    change = np.diff(windows.lat_speed_mps, axis=1) / STEP_S
    design = np.stack([-away.ravel(), -lat_speed.ravel()], axis=1)
    (attraction, damping), *_ = np.linalg.lstsq(design, change.ravel(), rcond=None)
    noise = _robust_std(change.ravel() - design @ np.array([attraction, damping])) * np.sqrt(STEP_S)
    spread = _robust_std(windows.offset_m[:, -1] - windows.offset_m[:, 0]) / np.sqrt(2.0)
    return LaneKeeper(
        attraction_per_s2=float(np.clip(attraction, 0.01, 2.0)),
        damping_per_s=float(np.clip(damping, 0.1, 5.0)),
        speed_noise=float(noise),
        offset_spread_m=float(spread),
        changes_per_s=changes_per_s,
        seen_changes_per_s=PROPOSED_CHANGES * changes_per_s,
    )


def _robust_std(values: FloatArray) -> float:
    """Return the standard deviation of a normal distribution with the same mean absolute value."""
    return float(np.abs(values).mean() * np.sqrt(np.pi / 2.0))


PERTURBED_SHARE = 0.5
POSITION_SPREAD_M = 3.0
SPEED_SPREAD_MPS = 1.0
ACCEL_SPREAD_MPS2 = 0.5
SPREAD_OF_LOG_SPREAD = 0.5
LEAST_GAP_LEFT_M = 0.5
FURTHEST_ASTRAY_M = 15.0
KEEP_EVERY_STEP = 3
ASKED_PER_S2, ASKED_PER_S, LAG_PER_S = 0.05, 0.4, 1.5
"""The way back: acceleration asked for per metre and per m/s astray, and the rate at which it is approached."""


Samples = tuple[FloatArray, FloatArray]
"""Inputs of shape (n, p) and outputs of shape (n, q)."""


def recovery_samples(led: CarFollowing, habit: FloatArray, count: int, rng: np.random.Generator) -> Samples:
    """Draw samples of windows with leaders, half of them perturbed and labelled with the way back.

    ``habit`` is what is known of each window's driver, shape (windows,).
    """
    windows, steps = led.lon_m.shape
    window, step = rng.integers(windows, size=count), rng.integers(steps - 1, size=count)
    perturbed = rng.random(count) < PERTURBED_SHARE
    spread = perturbed * np.exp(SPREAD_OF_LOG_SPREAD * rng.standard_normal(count))
    recorded_gap, recorded_speed = led.gap_m[window, step], led.speed_mps[window, step]
    astray_m = np.minimum(POSITION_SPREAD_M * spread * rng.standard_normal(count), recorded_gap - LEAST_GAP_LEFT_M)
    astray_m = np.where(perturbed, astray_m, 0.0)
    speed = np.maximum(recorded_speed + SPEED_SPREAD_MPS * spread * rng.standard_normal(count), 0.0)
    accel = led.accel_mps2[window, step] + perturbed * ACCEL_SPREAD_MPS2 * rng.standard_normal(count)
    x = _inputs(led, habit, (window, step), recorded_gap - astray_m, speed, accel)
    recorded_next = led.accel_mps2[window, step + 1]
    back = _way_back(accel, recorded_next, astray_m, speed - recorded_speed)
    return x, np.where(perturbed, back, recorded_next)[:, None]


def demonstrated_samples(
    led: CarFollowing, habit: FloatArray, model: ScaledGmm, rollouts: int, rng: np.random.Generator
) -> Samples:
    """Roll the model out behind the leaders of some windows and label the states that it reaches with the way back.

    The model's output is the acceleration of the next step; ``habit`` is as in ``recovery_samples``.
    """
    window = rng.choice(len(led), size=min(rollouts, len(led)), replace=False)
    gap_m, recorded_mps = led.gap_m[window], led.speed_mps[window]
    speed, accel = recorded_mps[:, 0], led.accel_mps2[window, 0]
    astray_m = np.zeros(len(window))
    inputs, outputs = [], []
    for step in range(gap_m.shape[1] - 1):
        gap = gap_m[:, step] - astray_m
        x = _inputs(led, habit, (window, np.full(len(window), step)), gap, speed, accel)
        if step % KEEP_EVERY_STEP == 0:
            back = _way_back(accel, led.accel_mps2[window, step + 1], astray_m, speed - recorded_mps[:, step])
            kept = (np.abs(astray_m) < FURTHEST_ASTRAY_M) & (gap > SMALLEST_GAP_M)
            inputs.append(x[kept])
            outputs.append(back[kept, None])
        next_speed = np.maximum(speed + STEP_S * model.sample(x, rng)[:, 0], 0.0)
        recorded_mean = 0.5 * (recorded_mps[:, step] + recorded_mps[:, step + 1])
        astray_m = astray_m + STEP_S * (0.5 * (speed + next_speed) - recorded_mean)
        accel = (next_speed - speed) / STEP_S
        speed = next_speed
    return np.concatenate(inputs), np.concatenate(outputs)


def _inputs(
    led: CarFollowing,
    habit: FloatArray,
    at: tuple[IntArray, IntArray],
    gap: FloatArray,
    speed: FloatArray,
    accel: FloatArray,
) -> FloatArray:
    """Return the situation of a follower behind the leaders of some windows and steps, with its driver's habit."""
    seen = situation(gap, speed, accel, led.leader.speed_mps[at], led.leader.accel_mps2[at])
    return np.hstack([seen, habit[at[0], None]])


def _way_back(
    accel: FloatArray, recorded_next: FloatArray, astray_m: FloatArray, speed_astray: FloatArray
) -> FloatArray:
    wanted = recorded_next - ASKED_PER_S2 * astray_m - ASKED_PER_S * speed_astray
    return accel + LAG_PER_S * STEP_S * (wanted - accel)


CELLS = (8, 6, 7, 7)
"""Along log gap, speed, closing speed and acceleration; each holds equally many moments of its axis."""
QUANTILES = 9
FEWEST = 30


def fit_empirical(led: CarFollowing) -> EmpiricalFollower:
    """Count the changes of acceleration until the next step of all windows, which must have leaders.

    A cell with fewer than 30 moments takes those of its gap, speed and acceleration whatever the closing speed, then
    those of its acceleration, so that no cell is empty where drivers have been.
    """
    now = slice(None, -1)
    seen = situation(*(column[:, now].ravel() for column in situation_columns(led))).T
    change = np.diff(led.accel_mps2, axis=1).ravel()
    axes = (seen[0], seen[1], seen[3], seen[2])
    inner = [np.linspace(0.0, 1.0, count + 1)[1:-1] for count in CELLS]
    edges = tuple(np.unique(np.quantile(axis, shares)) for axis, shares in zip(axes, inner, strict=True))
    shape = tuple(len(along) + 1 for along in edges)
    empty = EmpiricalFollower(edges, np.zeros((*shape, QUANTILES)))
    cell = empty.cells(seen)
    filled, counts = _quantiles(change, cell, int(np.prod(shape)))
    place = np.array(np.unravel_index(np.arange(len(filled)), shape))
    for kept in ((0, 1, 3), (3,)):
        coarse = np.ravel_multi_index(tuple(place[axis] for axis in kept), tuple(shape[axis] for axis in kept))
        instead, enough = _quantiles(change, coarse[cell], int(coarse.max()) + 1)
        short = (counts < FEWEST) & (enough[coarse] >= FEWEST)
        filled[short], counts[short] = instead[coarse[short]], enough[coarse[short]]
    return EmpiricalFollower(edges, filled.reshape(*shape, QUANTILES))


def _quantiles(values: FloatArray, cell: IntArray, cells: int) -> tuple[FloatArray, IntArray]:
    """Return the quantiles of the values in each cell, shape (cells, quantiles), and how many there are."""
    order = np.lexsort((values, cell))
    values, counts = values[order], np.bincount(cell, minlength=cells)
    first = np.cumsum(counts) - counts
    levels = first[:, None] + np.linspace(0.0, 1.0, QUANTILES) * np.maximum(counts - 1, 0)[:, None]
    return values[np.minimum(np.round(levels).astype(np.int64), len(values) - 1)], counts
