"""What the detections say for each component and each particle: the sums of the joint update over particles."""

from __future__ import annotations

import numba
import numpy as np

from mmpf.likelihood import GatedLikelihoods
from mmpf.road import FloatArray, IntArray


def normalised(log_weight: FloatArray, starts: IntArray) -> FloatArray:
    """Return weights that sum to one within each component, shape (n,)."""
    weight = np.empty(len(log_weight))
    _normalise(log_weight, starts, weight)
    return weight


def association_evidence(
    weight: FloatArray,
    starts: IntArray,
    detection_probability: FloatArray,
    missed_probability: FloatArray,
    likelihoods: GatedLikelihoods,
    detections: int,
) -> tuple[FloatArray, FloatArray]:
    """Return sum_n w P_D f(z_j | x) per pair, shape (m, d), and E[1 - P_missed] per component, shape (m,)."""
    components = len(starts) - 1
    evidence = np.zeros((components, detections))
    not_seen = np.ones(components)
    _sum_evidence(
        weight,
        starts,
        detection_probability,
        missed_probability,
        likelihoods.component,
        likelihoods.detection,
        likelihoods.values,
        likelihoods.starts,
        evidence,
        not_seen,
    )
    return evidence, not_seen


def particle_factors(
    detection_probability: FloatArray,
    missed_probability: FloatArray,
    starts: IntArray,
    likelihoods: GatedLikelihoods,
    message: FloatArray,
) -> FloatArray:
    """Return each particle's weight factor (1 - P_missed) + P_D sum_j nu_j f(z_j | x) / lambda, shape (n,)."""
    factor = 1.0 - missed_probability
    pair_message = message[likelihoods.component, likelihoods.detection]
    _add_detection_terms(
        detection_probability,
        starts,
        likelihoods.component,
        likelihoods.values,
        likelihoods.starts,
        pair_message,
        factor,
    )
    return factor


@numba.njit(cache=True)
def _normalise(log_weight: FloatArray, starts: IntArray, weight: FloatArray) -> None:
    for m in range(len(starts) - 1):
        begin, end = starts[m], starts[m + 1]
        largest = -np.inf
        for n in range(begin, end):
            largest = max(largest, log_weight[n])
        total = 0.0
        for n in range(begin, end):
            weight[n] = np.exp(log_weight[n] - largest)
            total += weight[n]
        for n in range(begin, end):
            weight[n] /= total


@numba.njit(cache=True)
def _sum_evidence(
    weight: FloatArray,
    starts: IntArray,
    detection_probability: FloatArray,
    missed_probability: FloatArray,
    pair_component: IntArray,
    pair_detection: IntArray,
    values: FloatArray,
    value_starts: IntArray,
    evidence: FloatArray,
    not_seen: FloatArray,
) -> None:
    for m in range(len(starts) - 1):
        seen = 0.0
        for n in range(starts[m], starts[m + 1]):
            seen += weight[n] * missed_probability[n]
        not_seen[m] = 1.0 - seen
    for p in range(len(pair_component)):
        begin = starts[pair_component[p]]
        total = 0.0
        for k in range(value_starts[p + 1] - value_starts[p]):
            total += weight[begin + k] * detection_probability[begin + k] * values[value_starts[p] + k]
        evidence[pair_component[p], pair_detection[p]] = total


@numba.njit(cache=True)
def _add_detection_terms(
    detection_probability: FloatArray,
    starts: IntArray,
    pair_component: IntArray,
    values: FloatArray,
    value_starts: IntArray,
    message: FloatArray,
    factor: FloatArray,
) -> None:
    for p in range(len(pair_component)):
        begin = starts[pair_component[p]]
        for k in range(value_starts[p + 1] - value_starts[p]):
            factor[begin + k] += detection_probability[begin + k] * message[p] * values[value_starts[p] + k]
