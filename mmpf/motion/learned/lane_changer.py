"""The paper's short-term model for lane changes: table I, 14 inputs, 6 outputs, one step ahead.

All lateral quantities count positive towards the target lane, from the middle of the original lane, so that changes to
either side share one mixture.
"""

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from mmpf.motion.gmm.model_file import MixtureFile, committed_mixture
from mmpf.motion.gmm.scaled import ScaledGmm
from mmpf.motion.kinematic import HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2
from mmpf.motion.protocol import NeighbourView, Surroundings, take_surroundings
from mmpf.motion.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.numerics.kernels import kernel, part_of_kernel

CHANGE = MixtureFile("lane-change", inputs=14, outputs=6)
FURTHEST_NEIGHBOUR_M = 100.0
NOBODY = np.array([[FURTHEST_NEIGHBOUR_M], [0.0]])
NOMINAL_WIDTH_M = 3.6
DIRECTION, ORIGIN = range(2)
LAT_SPEED_IN, SPEED_IN = 2, 3


@dataclass(frozen=True)
class ChangeView:
    """What a driver who changes lanes sees of the others; arrays of shape (n,), gaps capped at 100 m.

    Attributes:
        leader_gap_m: Clear distance to the leader in the original lane.
        follower_gap_m: Clear distance to the follower in the target lane.
        target_gap_m: Clear distance to the leader in the target lane.
        leader_relative_mps: Speed of the leader in the original lane over the own.
        follower_relative_mps: Speed of the follower in the target lane over the own.
        target_relative_mps: Speed of the leader in the target lane over the own.
    """

    leader_gap_m: FloatArray
    follower_gap_m: FloatArray
    target_gap_m: FloatArray
    leader_relative_mps: FloatArray
    follower_relative_mps: FloatArray
    target_relative_mps: FloatArray


def change_inputs(
    state: FloatArray, direction: FloatArray, origin_m: FloatArray, half_width_m: FloatArray, view: ChangeView
) -> FloatArray:
    """Return table I's inputs, shape (n, 14).

    Args:
        state: States, shape (6, n).
        direction: 1 for a change to the left, -1 to the right, shape (n,).
        origin_m: Lateral position of the original lane's middle, shape (n,).
        half_width_m: Half the lane width, shape (n,).
        view: What is seen of the others.
    """
    across = direction * (state[LAT] - origin_m)
    to_line = half_width_m - across
    return np.array(
        [
            across,
            state[LON],
            direction * state[LAT_SPEED],
            state[SPEED],
            direction * state[LAT_ACCEL],
            state[ACCEL],
            view.leader_gap_m,
            view.follower_gap_m,
            view.target_gap_m,
            to_line,
            to_line,
            view.leader_relative_mps,
            view.follower_relative_mps,
            view.target_relative_mps,
        ]
    ).T


def view_of(surroundings: Surroundings, speed_mps: FloatArray, direction: FloatArray, crossed: BoolArray) -> ChangeView:
    """Return what drivers see who change to one side, some of whom are over the line already.

    Args:
        surroundings: What the particles know.
        speed_mps: Own speeds, shape (n,).
        direction: 1 for a change to the left, -1 to the right, shape (n,).
        crossed: Whether the vehicle's middle is over the line, shape (n,); its follower is not known then.
    """
    to_left = direction > 0
    ahead = _seen(surroundings.leader, speed_mps)
    ahead_left, ahead_right = (_seen(n, speed_mps) for n in (surroundings.left_leader, surroundings.right_leader))
    behind_left, behind_right = (_seen(n, speed_mps) for n in (surroundings.left_follower, surroundings.right_follower))
    leader = np.where(crossed, np.where(to_left, ahead_right, ahead_left), ahead)
    follower = np.where(crossed, NOBODY, np.where(to_left, behind_left, behind_right))
    target = np.where(crossed, ahead, np.where(to_left, ahead_left, ahead_right))
    return ChangeView(leader[0], follower[0], target[0], leader[1], follower[1], target[1])


def _seen(neighbour: NeighbourView, speed_mps: FloatArray) -> FloatArray:
    """Return gap and relative speed of neighbours, shape (2, n); one too far away counts as none."""
    gap = neighbour.gap_m
    near = neighbour.exists & (gap < FURTHEST_NEIGHBOUR_M)
    return np.where(near, [gap, neighbour.speed_mps - speed_mps], NOBODY)


@dataclass(frozen=True)
class LaneChanger:
    """Moves vehicles that are changing lanes.

    Attributes:
        mixture: 14 inputs as in ``change_inputs``, 6 outputs: lateral and longitudinal advance, lateral and
            longitudinal speed, lateral and longitudinal acceleration 0.1 s later.
    """

    mixture: ScaledGmm = field(default_factory=partial(committed_mixture, CHANGE))

    def move_some(
        self,
        state: FloatArray,
        aims: FloatArray,
        surroundings: Surroundings,
        index: IntArray,
        dt_s: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return the states of the particles ``index``, shape (k,), one step later.

        Args:
            state: States of all, shape (6, n).
            aims: Direction in which each changes lanes, and the middle of the lane it is after, shape (2, n).
            surroundings: What the particles know.
            index: Which of them are changing lanes.
            dt_s: Length of the step.
            rng: Source of randomness.
        """
        around, (direction, target) = take_surroundings(surroundings, index), aims[:, index]
        width = around.lane_left_m - around.lane_right_m
        origin = target - direction * np.where(np.isfinite(width), width, NOMINAL_WIDTH_M)
        return self.move(state.take(index, axis=1), direction, origin, around, dt_s, rng)

    def move(
        self,
        state: FloatArray,
        direction: FloatArray,
        origin_m: FloatArray,
        surroundings: Surroundings,
        dt_s: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return the states one step later, shape (6, n).

        Args:
            state: States, shape (6, n).
            direction: 1 for a change to the left, -1 to the right, shape (n,).
            origin_m: Lateral position of the original lane's middle, shape (n,).
            surroundings: What the particles know.
            dt_s: Length of the step.
            rng: Source of randomness.
        """
        half_width = 0.5 * (surroundings.lane_left_m - surroundings.lane_right_m)
        half_width = np.where(np.isfinite(half_width), half_width, 0.5 * NOMINAL_WIDTH_M)
        crossed = np.asarray(direction * (state[LAT] - origin_m) > half_width)
        view = view_of(surroundings, state[SPEED], direction, crossed)
        x = change_inputs(state, direction, origin_m, half_width, view).T
        sampled = self.mixture.sample_columns(x, rng)
        low, high = self.mixture.scaling.input_low, self.mixture.scaling.input_high
        held_lat_speed, held_speed = (np.clip(x[i], low[i], high[i]) for i in (LAT_SPEED_IN, SPEED_IN))
        after = np.empty_like(state)
        advance(state, direction, sampled, held_lat_speed, held_speed, dt_s, after)
        return after


@dataclass(frozen=True)
class LaneChangeDriver:
    """A vehicle known to be changing lanes, as in the paper's second case; latents are its direction and original lane.

    Attributes:
        changer: Moves it.
        to_left: Whether it changes to the left.
        name: Name in the registry.
        latent_size: Direction (0 until the first step) and lateral position of the original lane's middle.
    """

    changer: LaneChanger = field(default_factory=LaneChanger)
    to_left: bool = True
    name: str = "gmm-lane-change"
    latent_size: int = 2

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Return latents that are set at the first step, when the lane is known: shape (2, n) of zeros."""
        return np.zeros((2, state.shape[1]))

    def propagate(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Sample the states one step later; see ``MotionModel.propagate``."""
        centre = 0.5 * (surroundings.lane_right_m + surroundings.lane_left_m)
        new = latents[DIRECTION] == 0.0
        origin = np.where(new, np.where(np.isfinite(centre), centre, state[LAT]), latents[ORIGIN])
        direction = np.where(new, 1.0 if self.to_left else -1.0, latents[DIRECTION])
        after = self.changer.move(state, direction, origin, surroundings, dt_s, rng)
        return after, np.stack([direction, origin])


TRAINED_STEP_S = 0.1
FASTEST_SIDEWAYS_MPS = 2.5
HARDEST_STEERING_MPS2 = 4.0
ADVANCE_TOLERANCE_M = 0.05


@kernel()
def advance(
    state: FloatArray,
    direction: FloatArray,
    sampled: FloatArray,
    held_lat_speed: FloatArray,
    held_speed: FloatArray,
    dt_s: float,
    after: FloatArray,
) -> None:
    """Write the states after a step.

    Args:
        state: States before, shape (6, n).
        direction: 1 for a change to the left, -1 to the right, shape (n,).
        sampled: Lateral and longitudinal advance, lateral and longitudinal speed, lateral and longitudinal
            acceleration after ``TRAINED_STEP_S``, lateral ones towards the target lane, shape (6, n).
        held_lat_speed: Lateral speed towards the target lane that the mixture was given, shape (n,).
        held_speed: Speed that it was given, shape (n,).
        dt_s: Length of the step.
        after: States after, shape (6, n), which are written.
    """
    steps = dt_s / TRAINED_STEP_S
    steering = HARDEST_STEERING_MPS2 * TRAINED_STEP_S
    braking, speeding = -HARDEST_BRAKING_MPS2 * TRAINED_STEP_S, STRONGEST_ACCEL_MPS2 * TRAINED_STEP_S
    for n in range(len(direction)):
        side, speed, lat_speed = direction[n], state[SPEED, n], state[LAT_SPEED, n]
        next_speed = max(speed + steps * _held(sampled[3, n] - held_speed[n], braking, speeding), 0.0)
        sideways = side * lat_speed + steps * _held(sampled[2, n] - held_lat_speed[n], -steering, steering)
        next_lat_speed = side * _held(sideways, -FASTEST_SIDEWAYS_MPS, FASTEST_SIDEWAYS_MPS)
        forward = _near(steps * sampled[1, n], 0.5 * dt_s * (speed + next_speed))
        after[LON, n] = state[LON, n] + max(forward, 0.0)
        after[LAT, n] = state[LAT, n] + _near(side * steps * sampled[0, n], 0.5 * dt_s * (lat_speed + next_lat_speed))
        after[SPEED, n] = next_speed
        after[LAT_SPEED, n] = next_lat_speed
        after[ACCEL, n] = _held(sampled[5, n], -HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2)
        after[LAT_ACCEL, n] = side * _held(sampled[4, n], -HARDEST_STEERING_MPS2, HARDEST_STEERING_MPS2)


@part_of_kernel()
def _held(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@part_of_kernel()
def _near(advance_m: float, by_speeds_m: float) -> float:
    """Return the sampled advance, held to 5 cm of the one that follows from the speeds."""
    return _held(advance_m, by_speeds_m - ADVANCE_TOLERANCE_M, by_speeds_m + ADVANCE_TOLERANCE_M)
