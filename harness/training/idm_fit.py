"""Fits the intelligent driver model's parameters to the training windows, as a rival with the same data."""

from __future__ import annotations

import numpy as np

from harness.training.following import Following
from mmpf.motion.idm import IdmParameters, idm_acceleration
from mmpf.motion.protocol import Neighbour
from mmpf.road import FloatArray

WINDOWS = 300
GENERATIONS = 30
POPULATION = 8
HORIZONS_S = (1.0, 2.0, 5.0, 10.0)
LOWEST = (20.0, 0.5, 0.3, 0.5, 1.0)
HIGHEST = (45.0, 2.5, 3.0, 5.0, 5.0)


def fit_idm(windows: Following, seed: int, step_s: float) -> IdmParameters:
    """Fit by differential evolution to the closed-loop position error, each horizon's in proportion to its length.

    Args:
        windows: Training windows; those without a leader are left out.
        seed: Seed of the choice of windows and of the search.
        step_s: Time between steps.
    """
    from scipy.optimize import Bounds, differential_evolution  # noqa: PLC0415

    rng = np.random.default_rng(seed)
    led = windows.take(np.flatnonzero(windows.has_leader))
    some = led.take(rng.choice(len(led), size=min(WINDOWS, len(led)), replace=False))

    def error(values: FloatArray) -> float:
        return _closed_loop_error(_parameters(values), some, step_s)

    found = differential_evolution(
        error,
        Bounds(LOWEST, HIGHEST),
        maxiter=GENERATIONS,
        popsize=POPULATION,
        rng=np.random.default_rng(seed),
        polish=False,
    )
    return _parameters(found.x)


def idm_toml(driver: IdmParameters) -> str:
    """Return the parameters as the committed file gives them."""
    lines = [f"{name} = {value:.4g}" for name, value in vars(driver).items()]
    return "\n".join(["# Parameters of the intelligent driver model fitted to the training recordings.", *lines, ""])


def _parameters(values: FloatArray) -> IdmParameters:
    speed, headway, accel, decel, gap = (float(value) for value in values)
    return IdmParameters(speed, headway, accel, decel, 4.0, gap)


def _closed_loop_error(driver: IdmParameters, windows: Following, step_s: float) -> float:
    speed, travelled = windows.speed_mps[:, 0], np.zeros(len(windows))
    gap_at_start = (
        windows.leader_lon_m - windows.lon_m[:, :1] - 0.5 * (windows.length_m + windows.leader_length_m)[:, None]
    )
    exists = np.ones(len(windows), dtype=np.bool_)
    steps_to_score = {round(horizon / step_s): horizon for horizon in HORIZONS_S}
    error = 0.0
    for step in range(1, windows.lon_m.shape[1]):
        leader = Neighbour(
            exists,
            gap_at_start[:, step - 1] - travelled,
            windows.leader_speed_mps[:, step - 1],
            windows.leader_accel_mps2[:, step - 1],
            windows.leader_length_m,
        )
        next_speed = np.maximum(speed + step_s * idm_acceleration(speed, leader, driver), 0.0)
        travelled = travelled + 0.5 * step_s * (speed + next_speed)
        speed = next_speed
        if step in steps_to_score:
            away = travelled - (windows.lon_m[:, step] - windows.lon_m[:, 0])
            error += float(np.abs(away).mean()) / steps_to_score[step]
    return error
