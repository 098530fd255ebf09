"""Lateral motion of a driver: keeping a position in the lane, and changing to the next lane."""

from dataclasses import dataclass

import numpy as np

from mmpf.motion.learned.kernel import LaneHolding, look_up_changes, switch_intentions
from mmpf.motion.protocol import Surroundings, offset_in_lane
from mmpf.motion.tries import log_ratios
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

WIDEST_LANE_M = 6.0
WIDEST_OFFSET_M = 1.0


@dataclass(frozen=True)
class LaneKeeper:
    """A damped pull towards a place in the lane, and the rate at which drivers mean to leave it.

    Attributes:
        attraction_per_s2: Lateral acceleration per metre away from the driver's place in the lane.
        damping_per_s: Lateral acceleration per m/s of lateral speed.
        speed_noise: White noise on the lateral speed, m/s per root second.
        offset_spread_m: Standard deviation of the driver's place in the lane about where it is now.
        changes_per_s: Rate at which an unseen driver takes up a change to one side.
        seen_changes_per_s: The same for a driver in sight, whose particles the measurements select: more of them try
            than drivers do, so that there are always some when a change begins.
    """

    attraction_per_s2: float
    damping_per_s: float
    speed_noise: float
    offset_spread_m: float
    changes_per_s: float
    seen_changes_per_s: float

    def draw_offset(
        self, lat_m: FloatArray, surroundings: Surroundings, index: IntArray, rng: np.random.Generator
    ) -> FloatArray:
        """Draw the places in the lane, metres from its middle, of particles ``index`` at ``lat_m``, (len(index),)."""
        right, left = surroundings.lane_right_m[index], surroundings.lane_left_m[index]
        offset = offset_in_lane(lat_m, right, left)
        spread = self.offset_spread_m * rng.standard_normal(len(index))
        # Where several vehicles have room side by side, the middle is nobody's place.
        widest = np.where(left - right > WIDEST_LANE_M, 0.5 * (left - right), WIDEST_OFFSET_M)
        return np.clip(offset + spread, -widest, widest)

    def switch_intentions(
        self, lat_m: FloatArray, aims: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> None:
        """Let some drivers at ``lat_m``, shape (n,), take up or end a lane change.

        Rewrites their ``aims``, shape (2, n): the direction in which each changes lanes, and the place it is after.
        """
        uniform = rng.random(len(lat_m), dtype=np.float32)
        probabilities = self.seen_changes_per_s * dt_s, self.changes_per_s * dt_s
        switch_intentions(aims[0], aims[1], lat_m, *_lanes_around(surroundings), uniform, *probabilities)

    def log_prior_over_tried(
        self, aims: FloatArray, after: FloatArray, surroundings: Surroundings, dt_s: float
    ) -> FloatArray:
        """Return what it says of weights that particles in sight take up changes more often; see ``TriesMore``.

        Args:
            aims: Direction and place of a lane change before the step, shape (2, n).
            after: The same after it.
            surroundings: What the particles knew.
            dt_s: Length of the step.
        """
        ratios = log_ratios(self.changes_per_s * dt_s, self.seen_changes_per_s * dt_s)
        log_ratio = np.empty(len(after[0]))
        look_up_changes(aims, after, *_lanes_around(surroundings), ratios, log_ratio)
        return log_ratio

    def holding(self, dt_s: float) -> LaneHolding:
        """Return what one step in the lane needs."""
        return LaneHolding(self.attraction_per_s2, self.damping_per_s, self.speed_noise * float(np.sqrt(dt_s)))


def _lanes_around(surroundings: Surroundings) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray, BoolArray]:
    lines = surroundings.lane_right_m, surroundings.lane_left_m
    return *lines, surroundings.has_left_lane, surroundings.has_right_lane, surroundings.is_hidden
