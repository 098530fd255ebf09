"""Likelihood sums over particles for each component and detection."""

from typing import NamedTuple

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments, gate_table, totals
from mmpf.joint.sources import sources_of
from mmpf.motion.heading_measurements import heading_ratio
from mmpf.motion.lane_following import HEADING
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.numerics.arrays import FloatArray, IntArray, taken
from mmpf.numerics.kernels import kernel
from mmpf.scan import BodyHeadings, Detections, SensorModel

LOG_SMALLEST = float(np.log(1e-300))
FEWEST_EFFECTIVE = 10.0


class GatedLikelihoods(NamedTuple):
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


def normalised(log_weight: FloatArray, starts: IntArray) -> FloatArray:
    """Return weights that sum to one within each component, shape (n,)."""
    weight = _below_largest(log_weight, starts)
    np.exp(weight, out=weight)
    weight /= np.repeat(totals(weight, starts), np.diff(starts))
    return weight


@kernel(fastmath=True)
def association_evidence(
    weight: FloatArray,
    starts: IntArray,
    detection_probability: FloatArray,
    likelihoods: GatedLikelihoods,
    detections: int,
) -> tuple[FloatArray, FloatArray]:
    """Return sum_n w P_D f(z_j | x) per pair, shape (m, d), and E[1 - P_D] per component, shape (m,)."""
    pair_component, pair_detection, values, value_starts = likelihoods
    evidence, not_seen = np.zeros((len(starts) - 1, detections)), np.ones(len(starts) - 1)
    for m in range(len(starts) - 1):
        seen = 0.0
        for n in range(starts[m], starts[m + 1]):
            seen += weight[n] * detection_probability[n]
        not_seen[m] = 1.0 - seen
    for p in range(len(pair_component)):
        begin, end = starts[pair_component[p]], starts[pair_component[p] + 1]
        own_weight, probability = weight[begin:end], detection_probability[begin:end]
        likelihood = values[value_starts[p] : value_starts[p + 1]]
        total = 0.0
        for k in range(len(likelihood)):
            total += own_weight[k] * probability[k] * likelihood[k]
        evidence[pair_component[p], pair_detection[p]] = total
    return evidence, not_seen


def particle_factors(
    detection_probability: FloatArray,
    starts: IntArray,
    likelihoods: GatedLikelihoods,
    message: FloatArray,
) -> FloatArray:
    """Return each particle's weight factor (1 - P_D) + P_D sum_j nu_j f(z_j | x) / lambda, shape (n,)."""
    factor = 1.0 - detection_probability
    pair_message = message[likelihoods.component, likelihoods.detection]
    _add_detection_terms(detection_probability, starts, likelihoods, pair_message, factor)
    return factor


def log_normalised(log_weight: FloatArray, starts: IntArray) -> FloatArray:
    """Return logarithms of weights that sum to one within each component, none below 1e-300, shape (n,)."""
    relative = _below_largest(log_weight, starts)
    log_total = np.log(totals(np.exp(relative), starts))
    relative -= np.repeat(log_total, np.diff(starts))
    return np.maximum(relative, LOG_SMALLEST, out=relative)


def clutter_densities(detections: Detections, sensor: SensorModel) -> FloatArray:
    """Return the density of clutter at each detection, per square metre and, where it is measured, m/s, shape (d,)."""
    per_speed = np.where(np.isfinite(detections.speed_mps), 1.0 / sensor.clutter_speed_span_mps, 1.0)
    return np.asarray(sensor.clutter_density_per_m2 * per_speed)


def _below_largest(log_weight: FloatArray, starts: IntArray) -> FloatArray:
    """Return each particle's number less the largest of its component, shape (n,)."""
    largest = np.maximum.reduceat(log_weight, starts[:-1]) if len(starts) > 1 else log_weight
    return np.asarray(log_weight - np.repeat(largest, np.diff(starts)))


@kernel(fastmath=True)
def _add_detection_terms(
    detection_probability: FloatArray,
    starts: IntArray,
    likelihoods: GatedLikelihoods,
    message: FloatArray,
    factor: FloatArray,
) -> None:
    pair_component, _, values, value_starts = likelihoods
    for p in range(len(pair_component)):
        begin, end = starts[pair_component[p]], starts[pair_component[p] + 1]
        own_factor, probability = factor[begin:end], detection_probability[begin:end]
        likelihood = values[value_starts[p] : value_starts[p + 1]]
        for k in range(len(likelihood)):
            own_factor[k] += probability[k] * message[p] * likelihood[k]


def gated_likelihoods(mixture: Mixture, moments: Moments, detections: Detections, gate_std: float) -> GatedLikelihoods:
    """Return f(z | x), a Gaussian in position and, where it is measured, speed, for all pairs within the gate.

    A pair counts if the detection is within ``gate_std`` standard deviations; see ``gate_table``. Gate and likelihood
    take the noise that the component has learned in place of what the detection reports. A detection so exact that it
    would fall between the particles is taken as just so noisy that some share it; see ``resolvable_std``.
    """
    noise_factor = sources_of(mixture).noise_factor
    component, detection = np.nonzero(gate_table(moments, detections, gate_std, noise_factor))
    particle_starts = mixture.starts
    sizes = np.diff(particle_starts)[component]
    factor = noise_factor[component]
    std = np.stack(
        [
            factor * detections.std_lon_m[detection],
            factor * detections.std_lat_m[detection],
            detections.std_speed_mps[detection],
        ]
    )
    reported = std
    std = resolvable_std(std, moments.std[[LON, LAT, SPEED]][:, component], sizes)
    correlation = np.zeros(len(component))
    if detections.correlation is not None:
        # What a floor adds along one axis has nothing to do with the other.
        share = reported[0] * reported[1] / (std[0] * std[1])
        correlation = share * detections.correlation[detection]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    values = np.empty(starts[-1])
    _evaluate(
        mixture.cloud.state,
        particle_starts,
        component,
        detection,
        np.stack([detections.lon_m, detections.lat_m, detections.speed_mps]),
        std,
        correlation,
        starts,
        values,
    )
    np.exp(values, out=values)
    if detections.headings is not None and mixture.has_headings:
        _weigh_headings(mixture, component, taken(detections.headings, detection), starts, values)
    return GatedLikelihoods(component, detection, values, starts)


def _weigh_headings(
    mixture: Mixture, component: IntArray, headings: BodyHeadings, starts: IntArray, values: FloatArray
) -> None:
    """Multiply likelihoods by those of measured directions, in place; arguments are as in ``gated_likelihoods``."""
    sizes = np.diff(starts)
    particle = np.arange(starts[-1]) + np.repeat(mixture.starts[component] - starts[:-1], sizes)
    measured = taken(headings, np.repeat(np.arange(len(component)), sizes))
    values *= heading_ratio(mixture.cloud.latents[HEADING, particle], measured)


def resolvable_std(std: FloatArray, spread: FloatArray, particles: IntArray) -> FloatArray:
    """Return the deviations of measurements, raised where too few particles would lie near the measurement, (axes, p).

    Along each axis about the share std / sqrt(std² + spread²) of the particles gets a weight that counts. If the
    product of the axes' shares leaves fewer than ``FEWEST_EFFECTIVE`` particles, the smallest shares are raised to a
    common floor at which that many are left. The other deviations are returned unchanged, to the byte.

    Args:
        std: Deviation of each pair's measurement along each axis, nan along an axis that is not measured, (axes, p).
        spread: Deviation of each pair's component, shape (axes, p).
        particles: Number of its particles, shape (p,).
    """
    share = np.where(np.isnan(std), 1.0, std / np.sqrt(std**2 + spread**2))
    target = np.minimum(FEWEST_EFFECTIVE / particles, 0.5)
    largest_first = -np.sort(-share, axis=0)
    floor = np.full(len(target), np.inf)
    others = np.ones(len(target))
    for raised in range(len(share), 0, -1):
        floor = np.minimum(floor, (target / others) ** (1.0 / raised))
        others = others * largest_first[len(share) - raised]
    at_floor = spread * floor / np.sqrt(1.0 - np.minimum(floor, 0.999) ** 2)
    return np.where(share < floor, at_floor, std)


@kernel()
def _evaluate(
    state: FloatArray,
    particle_starts: IntArray,
    component: IntArray,
    detection: IntArray,
    measured: FloatArray,
    std: FloatArray,
    correlation: FloatArray,
    starts: IntArray,
    values: FloatArray,
) -> None:
    """Write the logarithms. The exponential of a whole array is much faster than one by one."""
    for p in range(len(component)):
        begin, end = particle_starts[component[p]], particle_starts[component[p] + 1]
        j = detection[p]
        has_speed = np.isfinite(measured[2, j])
        std_lon, std_lat, std_speed = std[0, p], std[1, p], std[2, p]
        twice, rest = 2.0 * correlation[p], 1.0 - correlation[p] * correlation[p]
        half = 0.5 / rest
        log_normaliser = -np.log(2.0 * np.pi * std_lon * std_lat) - 0.5 * np.log(rest)
        if has_speed:
            log_normaliser -= np.log(np.sqrt(2.0 * np.pi) * std_speed)
        own_lon, own_lat, own = state[LON, begin:end], state[LAT, begin:end], values[starts[p] : starts[p + 1]]
        for n in range(len(own)):
            lon = (own_lon[n] - measured[0, j]) / std_lon
            lat = (own_lat[n] - measured[1, j]) / std_lat
            own[n] = log_normaliser - half * (lon * lon + lat * lat - twice * lon * lat)
        if has_speed:
            own_speed = state[SPEED, begin:end]
            for n in range(len(own)):
                speed = (own_speed[n] - measured[2, j]) / std_speed
                own[n] -= 0.5 * speed * speed
