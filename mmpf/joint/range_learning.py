"""Learns from each scan how the detection probability falls with distance."""

import numpy as np

from mmpf.belief.mixture import is_longer
from mmpf.joint.kinds import DETECTABILITY, VEHICLE, Sightings
from mmpf.joint.known import Known
from mmpf.joint.sources import Sources
from mmpf.numerics.arrays import FloatArray
from mmpf.options.joint import JointOptions
from mmpf.visibility.range_profile import Reach

# Vehicles of which less is to be seen say more of shadows than of distance.
IN_PLAIN_VIEW = 0.9
# Those that are hard to detect say more of themselves.
USUAL = 0.8
MEMORY_S = 60.0
"""Time constant with which counted detections are forgotten."""


def reach_after(
    sightings: Sightings,
    before: Sources,
    run: FloatArray,
    distance_m: FloatArray,
    known: Known,
    dt_s: float,
    options: JointOptions,
) -> Reach:
    """Return the counts of detections at each distance after a scan.

    Each vehicle in plain view counts as far as it exists, is a vehicle, is none that is hard to detect anywhere, and is
    not in a run of misses, which has nothing to do with distance.

    Args:
        sightings: What the scan says of the components.
        before: The components before the scan: what it says of existence would favour detections.
        run: Probability of a run of misses after the scan, shape (m,).
        distance_m: Their distances from the sensor, shape (m,).
        known: The sensor's data sheet and the counts before.
        dt_s: Time since the scan before.
        options: The joint rule's settings.
    """
    in_view = sightings.in_shadow / np.maximum(sightings.in_plain_view, 1e-3)
    is_in_view = (in_view > IN_PLAIN_VIEW) & (sightings.in_field > IN_PLAIN_VIEW)
    counted = np.flatnonzero(is_in_view & is_longer(before.detected_s, options.existence.confirm_s))
    usual = before.kinds[counted][:, VEHICLE][:, :, DETECTABILITY >= USUAL].sum(axis=(1, 2))
    weight = before.existence[counted] * usual
    expected = weight * (1.0 - run[counted]) * known.sensor.detection_probability
    kept = np.exp(-dt_s / MEMORY_S)
    return known.reach.after(distance_m[counted], expected, weight * sightings.hit[counted], kept)
