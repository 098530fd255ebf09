"""Lateral motion of a driver: holding a place in the lane, and crossing to the next lane when it means to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmpf.motion.protocol import Surroundings
from mmpf.normals import standard_normals
from mmpf.road import FloatArray, IntArray
from mmpf.state import LAT, LAT_ACCEL, LAT_SPEED, SPEED

OFFSET, INTENTION, TARGET = range(3)
WIDEST_OFFSET_M = 1.0
ARRIVED_WITHIN_M = 0.3
STEERING_LAG_S = 0.6
APPROACH_PER_S = 0.8
STEEPEST_CROSSING = 0.12


@dataclass(frozen=True)
class LaneKeeper:
    """A damped pull towards a place in the lane, and a crossing at steady speed towards the next lane.

    Attributes:
        attraction_per_s2: Lateral acceleration per metre away from the driver's place in the lane.
        damping_per_s: Lateral acceleration per m/s of lateral speed.
        speed_noise: White noise on the lateral speed, m/s per root second.
        offset_spread_m: Standard deviation of the driver's place in the lane about where it is now.
        changes_per_s: Rate at which an unseen driver takes up a change to one side.
        seen_changes_per_s: The same for a driver in sight, whose particles the measurements select.
        crossing_mps: Lateral speed of a lane change.
    """

    attraction_per_s2: float
    damping_per_s: float
    speed_noise: float
    offset_spread_m: float
    changes_per_s: float
    seen_changes_per_s: float
    crossing_mps: float

    def draw_offset(
        self, state: FloatArray, surroundings: Surroundings, index: IntArray, rng: np.random.Generator
    ) -> FloatArray:
        """Draw the places in the lane, metres from its middle, of particles ``index`` with states (6, len(index))."""
        offset = _offset(state, _centre(surroundings)[index])
        spread = self.offset_spread_m * rng.standard_normal(len(index))
        return np.clip(offset + spread, -WIDEST_OFFSET_M, WIDEST_OFFSET_M)

    def switch_intention(
        self,
        state: FloatArray,
        intention: FloatArray,
        surroundings: Surroundings,
        dt_s: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return intention and target, shape (2, n), after some drivers took up or ended a lane change."""
        direction, target = intention.copy()
        arrived = (direction != 0.0) & (direction * (target - state[LAT]) < ARRIVED_WITHIN_M)
        direction[arrived] = 0.0
        rate = np.where(surroundings.is_hidden, self.changes_per_s, self.seen_changes_per_s) * dt_s
        draw = rng.random(len(direction))
        centre = _centre(surroundings)
        may = (direction == 0.0) & np.isfinite(centre)
        width = surroundings.lane_left_m - surroundings.lane_right_m
        left = may & (draw < rate) & surroundings.has_left_lane
        right = may & (draw > 1.0 - rate) & surroundings.has_right_lane
        direction = np.where(left, 1.0, np.where(right, -1.0, direction))
        target = np.where(left, centre + width, np.where(right, centre - width, target))
        return np.stack([direction, target])

    def move_across(
        self,
        before: FloatArray,
        after: FloatArray,
        latents: FloatArray,
        surroundings: Surroundings,
        dt_s: float,
        rng: np.random.Generator,
    ) -> None:
        """Write the lateral rows after a step.

        Args:
            before: States at the step's start, shape (6, n).
            after: States at its end, shape (6, n); the lateral rows are written.
            latents: Place in the lane, intention and target, shape (3, n).
            surroundings: Where the lane lines are.
            dt_s: Length of the step.
            rng: Source of randomness.
        """
        away = _offset(before, _centre(surroundings)) - latents[OFFSET]
        away = np.where(np.isfinite(_centre(surroundings)), away, 0.0)
        keeping = -self.attraction_per_s2 * away - self.damping_per_s * before[LAT_SPEED]
        pull = np.where(latents[INTENTION] == 0.0, keeping, self._crossing(before, latents))
        kick = self.speed_noise * np.sqrt(dt_s) * standard_normals(rng, before.shape[1:])
        lat_speed = before[LAT_SPEED] + pull * dt_s + kick
        after[LAT] = before[LAT] + 0.5 * dt_s * (before[LAT_SPEED] + lat_speed)
        after[LAT_SPEED] = lat_speed
        after[LAT_ACCEL] = pull

    def _crossing(self, before: FloatArray, latents: FloatArray) -> FloatArray:
        left_to_go = latents[TARGET] - before[LAT]
        fastest = np.minimum(self.crossing_mps, STEEPEST_CROSSING * before[SPEED])
        wanted = np.clip(APPROACH_PER_S * left_to_go, -fastest, fastest)
        return np.asarray((wanted - before[LAT_SPEED]) / STEERING_LAG_S)


def _centre(surroundings: Surroundings) -> FloatArray:
    return 0.5 * (surroundings.lane_right_m + surroundings.lane_left_m)


def _offset(state: FloatArray, centre: FloatArray) -> FloatArray:
    return np.where(np.isfinite(centre), state[LAT] - centre, 0.0)
