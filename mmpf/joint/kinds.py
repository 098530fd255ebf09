"""The kind of source behind each component's detections: a vehicle, or a persistent false object.

Each component keeps one discrete posterior beside its particles: the probability of each kind of source (a vehicle, a
false object that stands, a false object that moves along with the traffic), together with how detectable it is and
whether shadows hide it. Detectability is unknown for each source (Mahler, Vo and Vo, IEEE TSP 2011), here on a grid in
place of a Beta distribution. A false object may end at any moment; a vehicle does not vanish in plain view. So a
source that is detected rarely is as good a vehicle as any, as long as it lasts and moves like one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmpf.numerics.arrays import FloatArray

KINDS = 3
VEHICLE, STANDING, MOVING = range(KINDS)
FALSE = slice(STANDING, None)
SHADING = np.array([1.0, 0.5, 0.0])
"""Power of a shadow's effect on detection. There are several, since no model of shadows and sensors is exact."""
DETECTABILITY = np.array([0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0])
"""Levels of a source's detection probability in plain view, over the one that the sensor has for vehicles there."""
LEVELS = len(DETECTABILITY)
SHAPE = (KINDS, len(SHADING), LEVELS)
"""Shape of one component's posterior by kind, how much shadows hide the source, and level of detectability."""
LARGEST_PROBABILITY = 0.99


@dataclass(frozen=True)
class Sightings:
    """The expected detection of a source at each of m components' places, before the scan.

    Attributes:
        in_shadow: Probability that a source of full detectability is detected, given the shadows, shape (m,).
        in_plain_view: The same if no shadow lay on it, shape (m,).
        in_field: Share of that probability that the edge of the field of view leaves, part of both, shape (m,).
        claimed: Sum over detections of message times likelihood ratio, per unit of expected detection, shape (m,).
        hit: Probability that the component was detected, shape (m,).
        run_probability: Probability of being in a run of misses, before the scan, shape (m,).
    """

    in_shadow: FloatArray
    in_plain_view: FloatArray
    in_field: FloatArray
    claimed: FloatArray
    hit: FloatArray
    run_probability: FloatArray

    def detection_probabilities(self) -> FloatArray:
        """Return the detection probability by how far shadows hide the source and its level, shape (m, 3, levels)."""
        relative = np.clip(self.in_shadow / np.maximum(self.in_plain_view, 1e-3), 1e-3, 1.0)
        full = ((1.0 - self.run_probability) * self.in_plain_view)[:, None] * relative[:, None] ** SHADING
        return np.asarray(np.minimum(full[:, :, None] * DETECTABILITY, LARGEST_PROBABILITY))


def certain_vehicles(count: int) -> FloatArray:
    """Return posteriors of vehicles with full detectability, fully hidden by shadows, shape (count, *SHAPE)."""
    kinds = np.zeros((count, *SHAPE))
    kinds[:, VEHICLE, 0, -1] = 1.0
    return kinds


def vehicle_share(kinds: FloatArray) -> FloatArray:
    """Return the probability that each source is a vehicle, given that there is one, shape (m,)."""
    return np.asarray(kinds[:, VEHICLE].sum(axis=(1, 2)))


def mean_detectability(kinds: FloatArray) -> FloatArray:
    """Return each source's expected detectability, given that there is one, shape (m,)."""
    return np.asarray((kinds.sum(axis=(1, 2)) * DETECTABILITY).sum(axis=1))


def weighed(alive: FloatArray, sightings: Sightings) -> FloatArray:
    """Return the unnormalised posterior after a scan: each case weighted by its likelihood of the scan.

    The Bernoulli update of each case (Reuter et al., IEEE TSP 2014): (1 - P_D) + P_D L, with L the likelihood ratio of
    the detections that may be the component's against clutter.

    Args:
        alive: Probability of each case before the scan, that there is a source included, shape (m, *SHAPE).
        sightings: What the sensor would make of it, and what it made.
    """
    probability = sightings.detection_probabilities()
    factor = 1.0 - probability + probability * sightings.claimed[:, None, None]
    return np.asarray(alive * factor[:, None])


def relaxed_shading(alive: FloatArray, usual: FloatArray, share: float) -> FloatArray:
    """Return the posterior with part of the knowledge on shading forgotten.

    Args:
        alive: The posterior, shape (m, *SHAPE).
        usual: Share of vehicles with each shading in the long run, shape (3,).
        share: How much is forgotten.
    """
    total = alive[:, VEHICLE].sum(axis=1)[:, None]
    relaxed = alive.copy()
    relaxed[:, VEHICLE] += share * (usual[:, None] * total - alive[:, VEHICLE])
    return relaxed


def shares_of(weights: Sequence[float] | FloatArray) -> FloatArray:
    """Return weights as shares that sum to one."""
    return np.asarray(weights) / sum(weights)


def bounded(kinds: FloatArray, least: float) -> FloatArray:
    """Return posteriors in which neither a vehicle nor a false object is less probable than ``least``."""
    share = vehicle_share(kinds)
    wanted = np.clip(share, least, 1.0 - least)
    within = kinds.copy()
    within[:, VEHICLE] *= (wanted / np.maximum(share, 1e-300))[:, None, None]
    within[:, FALSE] *= ((1.0 - wanted) / np.maximum(1.0 - share, 1e-300))[:, None, None, None]
    return normalised(within)


def normalised(kinds: FloatArray) -> FloatArray:
    """Return posteriors that sum to one for each source, shape (m, *SHAPE)."""
    return np.asarray(kinds / np.maximum(kinds.sum(axis=(1, 2, 3), keepdims=True), 1e-300))
