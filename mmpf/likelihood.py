"""Measurement likelihoods f(z | x) of particles for the detections within their component's gate."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from mmpf.moments import Moments
from mmpf.road import FloatArray, IntArray
from mmpf.scan import Detections
from mmpf.state import LAT, LON, SPEED, Mixture


@dataclass(frozen=True)
class GatedLikelihoods:
    """Likelihoods of the pairs of component and detection that lie within the gate; p pairs, component by component.

    Attributes:
        component: Component of each pair, ascending, shape (p,).
        detection: Detection of each pair, shape (p,).
        values: f(z | x) of the particles of each pair's component, one pair after the other.
        starts: Where each pair's values begin, and the end of the last, shape (p + 1,).
    """

    component: IntArray
    detection: IntArray
    values: FloatArray
    starts: IntArray


def gated_likelihoods(mixture: Mixture, moments: Moments, detections: Detections, gate_std: float) -> GatedLikelihoods:
    """Return f(z | x), a Gaussian in position and, where it is measured, speed, for all pairs within the gate.

    Args:
        mixture: The belief.
        moments: Its components' moments.
        detections: The scan's detections.
        gate_std: A pair counts if the detection is within this many standard deviations of component and
            measurement together, in both directions; infinite for all pairs.
    """
    inside = np.ones((len(mixture), len(detections)), dtype=np.bool_)
    for row, measured, std in (
        (LON, detections.lon_m, detections.std_lon_m),
        (LAT, detections.lat_m, detections.std_lat_m),
    ):
        spread = np.sqrt(moments.variance[row][:, None] + std[None, :] ** 2)
        inside &= np.abs(measured[None, :] - moments.mean[row][:, None]) <= gate_std * spread
    component, detection = np.nonzero(inside)
    sizes = np.diff(mixture.starts)[component]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    values = np.empty(starts[-1])
    _evaluate(
        mixture.cloud.state,
        mixture.starts,
        component,
        detection,
        np.stack([detections.lon_m, detections.lat_m, detections.speed_mps]),
        np.stack([detections.std_lon_m, detections.std_lat_m, detections.std_speed_mps]),
        starts,
        values,
    )
    np.exp(values, out=values)
    return GatedLikelihoods(component, detection, values, starts)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _evaluate(
    state: FloatArray,
    particle_starts: IntArray,
    component: IntArray,
    detection: IntArray,
    measured: FloatArray,
    std: FloatArray,
    starts: IntArray,
    values: FloatArray,
) -> None:
    """Write the logarithms: the exponential of a whole array takes a fraction of one by one."""
    for p in range(len(component)):
        begin, end = particle_starts[component[p]], particle_starts[component[p] + 1]
        j = detection[p]
        has_speed = np.isfinite(measured[2, j])
        log_normaliser = -np.log(2.0 * np.pi * std[0, j] * std[1, j])
        if has_speed:
            log_normaliser -= np.log(np.sqrt(2.0 * np.pi) * std[2, j])
        own_lon, own_lat, own = state[LON, begin:end], state[LAT, begin:end], values[starts[p] : starts[p + 1]]
        for n in range(len(own)):
            lon = (own_lon[n] - measured[0, j]) / std[0, j]
            lat = (own_lat[n] - measured[1, j]) / std[1, j]
            own[n] = log_normaliser - 0.5 * (lon * lon + lat * lat)
        if has_speed:
            own_speed = state[SPEED, begin:end]
            for n in range(len(own)):
                speed = (own_speed[n] - measured[2, j]) / std[2, j]
                own[n] -= 0.5 * speed * speed
