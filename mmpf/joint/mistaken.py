"""How probable it is that a component follows another source than the vehicle that was hidden.

The particles of a hidden component gather around the first detection that may be its own, and from the next scan on
they explain that source's detections better than anything else: that the vehicle may still be hidden is forgotten. So
each component keeps the probability that it was a mistake, and how far from its particles the vehicle is then. Both go
only into the reported deviations: those of a mixture of the two cases.
"""

import numpy as np

from mmpf.belief.moments import Moments
from mmpf.joint.association import Marginals
from mmpf.joint.false_objects import FalseObjects
from mmpf.joint.kinds import VEHICLE, Sightings, shares_of
from mmpf.joint.sources import Sources
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.options.joint import JointFalseObjects
from mmpf.scan import Detections

PLACED = [LON, LAT, SPEED]
FARTHEST_M = 20.0  # A vehicle that may be farther away is lost, as one whose own spread is wider is removed.


def mistaken_after(
    sources: Sources,
    before: Sources,
    sightings: Sightings,
    learned: FalseObjects,
    prior: JointFalseObjects,
    heading_rad: FloatArray,
    dt_s: float,
) -> Sources:
    """Return the components with the probability of a mistake after a scan, by Bayes' rule on its odds.

    A detection multiplies the odds by the probability that a false object still exists and is detected, over that of a
    vehicle's detection. A miss multiplies them by the ratio of the opposite probabilities.

    Args:
        sources: The components after the scan.
        before: The components before it.
        sightings: Detection probabilities at the components' places.
        learned: Learned kinds, lifetimes and detectability of false objects.
        prior: Their prior values.
        heading_rad: Where each component's vehicle points against the frame's longitudinal axis, shape (m,).
        dt_s: Time since the previous scan.
    """
    seen = sightings.detection_probabilities()
    kinds = learned.kind_shares(prior)
    false = shares_of(prior.shading)[:, None] * (kinds @ learned.profiles(prior)) * seen
    vehicle = before.kinds[:, VEHICLE] * seen / np.maximum(before.vehicle_share, 1e-300)[:, None, None]
    by_false, by_vehicle = (np.maximum(each.sum(axis=(1, 2)), 1e-6) for each in (false, vehicle))
    by_false *= np.exp(-dt_s / (kinds @ learned.mean_life_s(prior)))
    ratio = np.where(sources.unseen_s == 0.0, by_false / by_vehicle, (1.0 - by_false) / (1.0 - by_vehicle))
    mistaken = sources.mistaken * ratio / (1.0 - sources.mistaken + sources.mistaken * ratio)
    away = sources.away_std.copy()
    grown_m = dt_s * away[:, 2]
    away[:, 0] = np.minimum(away[:, 0] + grown_m * np.abs(np.cos(heading_rad)), FARTHEST_M)
    away[:, 1] = np.minimum(away[:, 1] + grown_m * np.abs(np.sin(heading_rad)), FARTHEST_M)
    return sources.having(mistaken=mistaken, away_std=away)


def retaken(
    sources: Sources, which: IntArray, marginals: Marginals, moments: Moments, detections: Detections
) -> Sources:
    """Return the components after some of them, hidden before the scan, were detected again.

    Args:
        sources: The components.
        which: Those that were, shape (k,).
        marginals: Which detection is whose.
        moments: Their moments before the scan, m components.
        detections: The scan's detections.
    """
    by = marginals.probability[which].argmax(axis=1) if len(which) else which
    hidden = moments.take(which)
    offset = np.zeros_like(hidden.mean[PLACED])
    offset[:2] = detections.lon_m[by] - hidden.mean[LON], detections.lat_m[by] - hidden.mean[LAT]
    return with_mistakes(sources, which, 1.0 - marginals.probability[which, by], offset, hidden)


def with_mistakes(
    sources: Sources, which: IntArray, probability: FloatArray, offset: FloatArray, hidden: Moments
) -> Sources:
    """Return the components after some of them have taken detections for those of a hidden vehicle.

    Args:
        sources: The components.
        which: Those that did, shape (k,).
        probability: Probability that the detections are another's, shape (k,); a larger one from before stays.
        offset: How far the detections are from the expected place and speed, shape (3, k).
        hidden: Moments of the vehicle as it was expected, k components.
    """
    mistaken, away = sources.mistaken.copy(), sources.away_std.copy()
    more = probability > mistaken[which]
    mistaken[which[more]] = probability[more]
    away[which[more]] = np.sqrt(offset**2 + hidden.variance[PLACED]).T[more]
    return sources.having(mistaken=mistaken, away_std=away)
