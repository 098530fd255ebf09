"""Differences of each main lane from the mean of all lanes, in simulated and recorded traffic.

Ratios, because recordings are short and of no particular part of a period: a lane's own speed says more of the minute
than of the lane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.lab.fidelity.samples import BehaviourSamples
from mmpf.numerics.arrays import FloatArray

RESAMPLES = 1000
INTERVAL = (0.025, 0.975)


@dataclass(frozen=True)
class LaneShare:
    """One main lane, 1 the leftmost: speed and flow over the mean of all, with 95 % intervals over recordings."""

    lane: int
    simulated_speed: float
    measured_speed: float
    measured_speed_interval: tuple[float, float]
    simulated_flow: float
    measured_flow: float
    measured_flow_interval: tuple[float, float]


def lane_shares(simulated: BehaviourSamples, recorded: BehaviourSamples) -> tuple[LaneShare, ...]:
    """Compare each main lane; none where one side has no vehicle on a lane."""
    pieces = recorded.by_lane
    if not (simulated.by_lane.sum(axis=0) > 0.0).all() or not (pieces.sum(axis=0) > 0.0).all():
        return ()
    rng = np.random.default_rng(0)
    drawn = [ratios(pieces[rng.integers(len(pieces), size=len(pieces))]) for _ in range(RESAMPLES)]
    low, high = np.nanquantile(drawn, INTERVAL, axis=0)
    found, measured = ratios(simulated.by_lane), ratios(pieces)
    return tuple(
        LaneShare(
            lane=lane + 1,
            simulated_speed=float(found[lane, 0]),
            measured_speed=float(measured[lane, 0]),
            measured_speed_interval=(float(low[lane, 0]), float(high[lane, 0])),
            simulated_flow=float(found[lane, 1]),
            measured_flow=float(measured[lane, 1]),
            measured_flow_interval=(float(low[lane, 1]), float(high[lane, 1])),
        )
        for lane in range(pieces.shape[1])
    )


def ratios(pieces: FloatArray) -> FloatArray:
    """Return each lane's speed and flow over those of all lanes, shape (lanes, 2).

    Args:
        pieces: Time spent and distance travelled on each lane, shape (pieces, lanes, 2).
    """
    time_s, distance_m = pieces.sum(axis=0).T
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = distance_m / time_s
    return np.stack([speed / (distance_m.sum() / time_s.sum()), distance_m / distance_m.mean()], axis=1)
