"""Runs of misses: the probability that the sensor is in the middle of one for a vehicle.

A two-state chain per component beside its particles: in one state the data sheet holds, in the other the vehicle is
missed wherever it is. It is filtered with the component, so that one miss is no surprise, a few in a row are probably a
run, and neither existence nor particles pay for the rest of it.
"""

import numpy as np

from mmpf.numerics.arrays import FloatArray

LASTS_ON = 2.0
"""A lasting run lasts on for the mean length of a new one and this many times as long as it has lasted (Lomax 1954)."""


def run_expected(missed: FloatArray, share: float, run_s: FloatArray | float, dt_s: float) -> FloatArray:
    """Return the probability of being in a run of misses a step later, shape (m,).

    Args:
        missed: The probability now, shape (m,).
        share: Share of time that vehicles spend in runs.
        run_s: How long a run lasts on in the mean, shape (m,) or one number.
        dt_s: Length of the step.
    """
    ends = -np.expm1(-dt_s / (run_s * (1.0 - share)))
    return np.asarray(missed + ends * (share - missed))


def run_after_scan(expected: FloatArray, not_seen: FloatArray, claimed: FloatArray) -> FloatArray:
    """Return the probability of a run after a scan by Bayes' rule: a detection ends any run, shape (m,).

    Args:
        expected: The probability before the scan, shape (m,).
        not_seen: Probability of no detection, runs included, shape (m,).
        claimed: Weight of all detections that may be the component's, on the same scale, shape (m,).
    """
    return np.minimum(expected / np.maximum(not_seen + claimed, 1e-300), 1.0)
