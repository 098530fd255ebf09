"""Samples that teach a driver model to recover from its own errors: recovery labels and data as demonstrator.

A model fitted to recorded states alone never sees its own mistakes, so closed-loop errors grow. Recovery labels perturb
the recorded state and ask for the acceleration that leads back to the recorded trajectory. Data as demonstrator
(Venkatraman, Hebert and Bagnell, AAAI 2015) does the same to the states that the fitted model itself reaches.
"""

from __future__ import annotations

import numpy as np

from harness.lab.windows.car_following import CarFollowing
from harness.truth.frame import STEP_S
from mmpf.motion.gmm.scaled import ScaledGmm
from mmpf.motion.learned.features import SMALLEST_GAP_M, situation
from mmpf.numerics.arrays import FloatArray, IntArray

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
    seen = situation(gap, speed, accel, led.leader_speed_mps[at], led.leader_accel_mps2[at])
    return np.hstack([seen, habit[at[0], None]])


def _way_back(
    accel: FloatArray, recorded_next: FloatArray, astray_m: FloatArray, speed_astray: FloatArray
) -> FloatArray:
    wanted = recorded_next - ASKED_PER_S2 * astray_m - ASKED_PER_S * speed_astray
    return accel + LAG_PER_S * STEP_S * (wanted - accel)
