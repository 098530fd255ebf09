"""What speed says about a source's kind: most false objects stand; vehicles move with the traffic or have stopped."""

import numpy as np

from mmpf.belief.birth import Traffic, local_speed
from mmpf.belief.mixture import Components
from mmpf.belief.moments import Moments
from mmpf.joint.overlap import separations
from mmpf.map.road import Road
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.numerics.arrays import FloatArray
from mmpf.options.joint import JointSpeeds

# Vehicles queue so far before a stop line.
QUEUE_M = 50.0
STOPPED_IN_PLANE, STOPPED_AT_LINE, STOPPED_ELSEWHERE = 0.3, 0.6, 0.15
"""Share of standing vehicles in flowing traffic in a plane without known stop lines, a little before one, elsewhere."""
QUEUE_SCALE_M, LANE_STD_M = 20.0, 2.5
"""How far along and across a road vehicles that stand make it probable that others do."""
STANDING_STD_MPS, FLOW_STD_MPS = 1.0, 4.0
"""Spread of the speeds of standing objects, and of vehicles' speeds around the traffic's."""


def stopped_shares(moments: Moments, road: Road, options: JointSpeeds) -> FloatArray | float:
    """Return the share of vehicles that stands where each component is, of shape (m,) where stop lines are known."""
    to_line = road.to_stop_line_m(moments.mean[LON], moments.mean[LAT], moments.heading_rad)
    if to_line is None:
        return STOPPED_IN_PLANE if road.has_headings else options.stopped_on_road
    return np.where(to_line < QUEUE_M, STOPPED_AT_LINE, STOPPED_ELSEWHERE)


def stopped_among(components: Components, moments: Moments, usual: FloatArray | float) -> FloatArray | float:
    """Return the share of vehicles that stands where each component is, given who stands near it, shape (m,).

    Queues form behind a stopped car. The share is the mean over the other components, weighted by how near they are and
    how probably vehicles, and one imaginary vehicle of the usual share. They can only raise it: traffic drives past a
    broken-down car. In the plane, where stop lines explain queues, it is the usual one.

    Args:
        components: The components.
        moments: Their moments.
        usual: Share of vehicles that stands there otherwise, shape (m,) or for all.
    """
    if moments.has_headings:
        return usual
    along_m, across_m = separations(moments)
    weight = np.exp(-along_m / QUEUE_SCALE_M - 0.5 * (across_m / LANE_STD_M) ** 2)
    np.fill_diagonal(weight, 0.0)
    weight *= components.vehicle
    stands = _normal(moments.mean[SPEED], moments.variance[SPEED] + STANDING_STD_MPS**2)
    return np.asarray(np.maximum((usual + weight @ stands) / (1.0 + weight.sum(axis=1)), usual))


def stood_log_after(before: FloatArray, moments: Moments) -> FloatArray:
    """Return the log likelihood that each source always stood, given its speeds so far, shape (m,); 0 if unknown.

    Args:
        before: The same before this scan, shape (m,).
        moments: The components' moments.
    """
    variance = moments.variance[SPEED]
    standing = -0.5 * moments.mean[SPEED] ** 2 / (variance + STANDING_STD_MPS**2)
    return np.where(variance <= STANDING_STD_MPS**2, np.minimum(before, standing), before)


def log_speed_likelihoods(
    moments: Moments,
    traffic: Traffic,
    range_m: float,
    stopped: FloatArray | float,
    stood_log: FloatArray | float = 0.0,
) -> FloatArray:
    """Return the log likelihood of each component's speed if it is of each kind, up to a common constant, shape (m, 3).

    A vehicle may stand amid flowing traffic: what its speed can say against it is bounded by the share of vehicles
    that do. What was seen to move is no false object that stands.

    Args:
        moments: The components' moments.
        traffic: Speeds of the vehicles around.
        range_m: How far the traffic around reaches.
        stopped: Share of vehicles that stand though others flow, shape (m,) or for all.
        stood_log: How well the speeds so far fit one that always stood, shape (m,); see ``stood_log_after``.
    """
    speed, variance = moments.mean[SPEED], moments.variance[SPEED]
    flow = local_speed(moments.mean[LON], moments.mean[LAT], traffic, range_m)
    flowing = _normal(speed - flow, variance + FLOW_STD_MPS**2)
    standing = _normal(speed, variance + STANDING_STD_MPS**2)
    slowest = _normal(np.zeros_like(speed), variance + STANDING_STD_MPS**2)
    vehicle = stopped * standing + (1.0 - stopped) * flowing
    always_stood = np.minimum(standing, slowest * np.exp(stood_log))
    return np.asarray(np.log(np.maximum(np.stack([vehicle, always_stood, flowing], axis=1), 1e-12)))


def _normal(difference: FloatArray, variance: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-0.5 * difference**2 / variance) / np.sqrt(variance))
