"""Samples that teach a driver model to recover from its own errors: recovery labels and data as demonstrator.

A model fitted to recorded states alone never sees its own mistakes, so closed-loop errors grow. Recovery labels perturb
the recorded state and ask for the acceleration that leads back to the recorded trajectory. Data as demonstrator
(Venkatraman, Hebert and Bagnell, AAAI 2015) does the same to the states that the fitted model itself reaches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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


@dataclass(frozen=True)
class FollowingRecords:
    """Recorded followers and leaders, arrays of shape (windows, steps); ``habit`` of shape (windows, h)."""

    gap_m: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    leader_speed_mps: FloatArray
    leader_accel_mps2: FloatArray
    habit: FloatArray
    step_s: float


@dataclass(frozen=True)
class RecoverySamples:
    """Inputs of shape (n, p) and outputs of shape (n, q)."""

    x: FloatArray
    y: FloatArray


def recovery_samples(records: FollowingRecords, count: int, rng: np.random.Generator) -> RecoverySamples:
    """Draw samples of the records, most of them perturbed and labelled with the way back."""
    windows, steps = records.gap_m.shape
    window, step = rng.integers(windows, size=count), rng.integers(steps - 1, size=count)
    perturbed = rng.random(count) < PERTURBED_SHARE
    spread = perturbed * np.exp(SPREAD_OF_LOG_SPREAD * rng.standard_normal(count))
    recorded_gap, recorded_speed = records.gap_m[window, step], records.speed_mps[window, step]
    astray_m = np.minimum(POSITION_SPREAD_M * spread * rng.standard_normal(count), recorded_gap - LEAST_GAP_LEFT_M)
    astray_m = np.where(perturbed, astray_m, 0.0)
    speed = np.maximum(recorded_speed + SPEED_SPREAD_MPS * spread * rng.standard_normal(count), 0.0)
    accel = records.accel_mps2[window, step] + perturbed * ACCEL_SPREAD_MPS2 * rng.standard_normal(count)
    x = _inputs(records, window, step, recorded_gap - astray_m, speed, accel)
    recorded_next = records.accel_mps2[window, step + 1]
    back = _way_back(accel, recorded_next, astray_m, speed - recorded_speed, records.step_s)
    return RecoverySamples(x, np.where(perturbed, back, recorded_next)[:, None])


def demonstrated_samples(
    records: FollowingRecords, model: ScaledGmm, rollouts: int, rng: np.random.Generator
) -> RecoverySamples:
    """Roll the model out behind the leaders of some windows and label the states that it reaches with the way back.

    The model's output is the acceleration of the next step.
    """
    window = rng.choice(len(records.gap_m), size=min(rollouts, len(records.gap_m)), replace=False)
    speed, accel = records.speed_mps[window, 0], records.accel_mps2[window, 0]
    astray_m = np.zeros(len(window))
    inputs, outputs = [], []
    for step in range(records.gap_m.shape[1] - 1):
        gap = records.gap_m[window, step] - astray_m
        x = _inputs(records, window, np.full(len(window), step), gap, speed, accel)
        if step % KEEP_EVERY_STEP == 0:
            recorded_next = records.accel_mps2[window, step + 1]
            away = speed - records.speed_mps[window, step]
            back = _way_back(accel, recorded_next, astray_m, away, records.step_s)
            kept = (np.abs(astray_m) < FURTHEST_ASTRAY_M) & (gap > SMALLEST_GAP_M)
            inputs.append(x[kept])
            outputs.append(back[kept, None])
        next_speed = np.maximum(speed + records.step_s * model.sample(x, rng)[:, 0], 0.0)
        recorded_mean = 0.5 * (records.speed_mps[window, step] + records.speed_mps[window, step + 1])
        astray_m = astray_m + records.step_s * (0.5 * (speed + next_speed) - recorded_mean)
        accel = (next_speed - speed) / records.step_s
        speed = next_speed
    return RecoverySamples(np.concatenate(inputs), np.concatenate(outputs))


def _inputs(
    records: FollowingRecords,
    window: IntArray,
    step: IntArray,
    gap: FloatArray,
    speed: FloatArray,
    accel: FloatArray,
) -> FloatArray:
    leader_speed, leader_accel = records.leader_speed_mps[window, step], records.leader_accel_mps2[window, step]
    return np.hstack([situation(gap, speed, accel, leader_speed, leader_accel), records.habit[window]])


def _way_back(
    accel: FloatArray,
    recorded_next: FloatArray,
    astray_m: FloatArray,
    speed_astray: FloatArray,
    step_s: float,
) -> FloatArray:
    wanted = recorded_next - ASKED_PER_S2 * astray_m - ASKED_PER_S * speed_astray
    return accel + LAG_PER_S * step_s * (wanted - accel)
