"""The size of every kinematic model's process noise, by one procedure: maximum likelihood of the state one second on.

Each model runs without noise from recorded states for one second. Its errors in position and speed are taken for those
of white noise driving the speed (CVM, CSAV, IDM) or the acceleration (CAM, CSAA), integrated over the second; the
likelihood's maximum over the noise's spectral density is then ``mean(e' Q^-1 e) / 2`` with Q for unit density.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.driving.cases import Cases
from harness.training.idm_fit import Adaptive
from mmpf.compute.arrays import FloatArray
from mmpf.motion.idm import AdaptiveDriver, IdmParameters, intelligent_driver
from mmpf.motion.kinematic import ProcessNoise, kinematic
from mmpf.motion.protocol import MotionModel
from mmpf.state import LAT, LAT_SPEED, LON, SPEED

AHEAD_S = 1.0
NO_NOISE = ProcessNoise(0.0, 0.0)
SPEED_DRIVEN = np.array([[1.0 / 3.0, 0.5], [0.5, 1.0]])
ACCEL_DRIVEN = np.array([[1.0 / 20.0, 1.0 / 8.0], [1.0 / 8.0, 1.0 / 3.0]])


def fit_noise(traffic: Sequence[Cases], fitted: IdmParameters, adaptive: Adaptive) -> dict[str, ProcessNoise]:
    """Return the noise of each kinematic model.

    Args:
        traffic: Lane keeping and lane changes of the tuning seeds, each as often as it happens.
        fitted: Parameters of ``idm-fitted``.
        adaptive: Parameters of ``idm-adaptive``.
    """
    rivals: tuple[tuple[MotionModel, FloatArray, FloatArray], ...] = (
        (kinematic("cvm", NO_NOISE), SPEED_DRIVEN, SPEED_DRIVEN),
        (kinematic("cam", NO_NOISE), ACCEL_DRIVEN, ACCEL_DRIVEN),
        (kinematic("csav", NO_NOISE), SPEED_DRIVEN, ACCEL_DRIVEN),
        (kinematic("csaa", NO_NOISE), ACCEL_DRIVEN, ACCEL_DRIVEN),
        (intelligent_driver(noise=NO_NOISE), SPEED_DRIVEN, SPEED_DRIVEN),
        (intelligent_driver(fitted, NO_NOISE, "idm-fitted"), SPEED_DRIVEN, SPEED_DRIVEN),
        (AdaptiveDriver(*adaptive, NO_NOISE), SPEED_DRIVEN, SPEED_DRIVEN),
    )
    return {model.name: _most_likely(model, lon, lat, traffic) for model, lon, lat in rivals}


def noise_toml(sizes: dict[str, ProcessNoise]) -> str:
    """Return the noise as the committed file gives it."""
    head = (
        "# Root spectral density of the white noise that drives each model: acceleration (m/s^2 per root second)\n"
        "# for cam, csaa and csav across the road, speed (m/s per root second) for all others.\n"
        "# Found by maximum likelihood of the state one second on, over the tuning seeds.\n"
    )
    tables = (f'["{name}"]\nlon = {noise.lon:.4g}\nlat = {noise.lat:.4g}\n' for name, noise in sizes.items())
    return head + "\n".join(tables)


def _most_likely(
    model: MotionModel, lon_shape: FloatArray, lat_shape: FloatArray, traffic: Sequence[Cases]
) -> ProcessNoise:
    away = np.concatenate([_errors(model, cases) for cases in traffic], axis=1)
    return ProcessNoise(_density(away[:2], lon_shape), _density(away[2:], lat_shape))


def _errors(model: MotionModel, cases: Cases) -> FloatArray:
    """Return errors in longitudinal position and speed, lateral position and speed, of all seconds: shape (4, n)."""
    ahead = round(AHEAD_S / cases.step_s)
    starts = range(0, cases.steps - ahead, ahead)
    return np.concatenate([_errors_from(model, cases, start, start + ahead) for start in starts], axis=1)


def _errors_from(model: MotionModel, cases: Cases, start: int, end: int) -> FloatArray:
    rng = np.random.default_rng(0)
    state = cases.truth[start]
    latents = model.draw_latents(state, rng)
    for step in range(start, end):
        state, latents = model.propagate(state, latents, cases.surroundings(state, step, True), cases.step_s, rng)
    return np.asarray((state - cases.truth[end])[[LON, SPEED, LAT, LAT_SPEED]])


def _density(errors: FloatArray, shape: FloatArray) -> float:
    return float(np.sqrt(np.einsum("in,ij,jn->n", errors, np.linalg.inv(shape), errors).mean() / 2.0))
