"""The protocol of car following in the learned driver, and the Gaussian mixture ``gmm``."""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from mmpf.motion.gmm.scaled import ScaledGmm
from mmpf.motion.learned.features import FURTHEST_LEADER_M, SITUATION_SIZE, gather_situations, situation
from mmpf.motion.protocol import Neighbour
from mmpf.motion.state import ACCEL, SPEED
from mmpf.numerics.arrays import BoolArray, Float32Array, FloatArray, IntArray


class Follower(Protocol):
    """Draws the accelerations of particles that follow a leader.

    Attributes:
        latent_size: Rows that it keeps of each particle's driver.
        drives_alone: Whether it also drives particles without a leader, where no map says how fast.
    """

    @property
    def latent_size(self) -> int: ...  # noqa: D102
    @property
    def drives_alone(self) -> bool: ...  # noqa: D102

    def draw(self, state: FloatArray, leader: Neighbour, index: IntArray, rng: np.random.Generator) -> FloatArray:
        """Draw the drivers of the particles ``index``, with or without leaders: rows of shape (latent_size, k).

        There may be fewer rows: the others are a memory, zero at birth, which a particle keeps when its driver is drawn
        anew.
        """

    def accelerations(
        self,
        state: FloatArray,
        drivers: FloatArray,
        leader: Neighbour,
        index: IntArray,
        dt_s: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Draw the accelerations of the particles ``index`` until the next step, shape (k,).

        Args:
            state: States of all n particles, shape (6, n).
            drivers: Their drivers, shape (latent_size, n); may be rewritten.
            leader: Their leaders.
            index: Particles that follow, and those without a leader if it ``drives_alone``, shape (k,).
            dt_s: Length of the step.
            rng: Source of randomness.
        """


def follows(leader: Neighbour) -> BoolArray:
    """Return which particles have a leader near enough to follow, shape (n,)."""
    return leader.exists & (leader.gap_m < FURTHEST_LEADER_M)


def situations(state: FloatArray, leader: Neighbour, index: IntArray) -> FloatArray:
    """Return what the particles ``index`` see, (k, 5); one without a leader sees a far one at its own speed."""
    own_speed, own_leader = state[SPEED, index], leader.take(index)
    led = follows(own_leader)
    gap = np.where(led, own_leader.gap_m, FURTHEST_LEADER_M)
    leader_speed = np.where(led, own_leader.speed_mps, own_speed)
    leader_accel = np.where(led, own_leader.accel_mps2, 0.0)
    return situation(gap, own_speed, state[ACCEL, index], leader_speed, leader_accel)


def seen_by(index: IntArray, state: FloatArray, leader: Neighbour, drivers: FloatArray) -> Float32Array:
    """Return what followers see, and below it rows of all drivers, (r, n): shape (5 + r, k)."""
    seen = np.empty((SITUATION_SIZE + len(drivers), len(index)), dtype=np.float32)
    ahead = leader.speed_mps, leader.accel_mps2
    gather_situations(index, leader.gap_m, state[SPEED], state[ACCEL], *ahead, drivers, seen)
    # Of the whole row: compiled one by one, logarithms take several times as long.
    np.log(seen[0], out=seen[0])
    return seen


@dataclass(frozen=True)
class MixtureFollower:
    """Follows by a Gaussian mixture; a driver is the headway that it keeps in the long run and a constant deviation.

    Attributes:
        following: Acceleration of the next step given the situation (5 numbers) and the habit.
        habit: Logarithm of the time headway that a driver keeps in the long run, given the situation.
        accel_bias_mps2: Standard deviation of a driver's constant deviation in acceleration.
    """

    following: ScaledGmm
    habit: ScaledGmm
    accel_bias_mps2: float
    latent_size: ClassVar[int] = 2
    drives_alone: ClassVar[bool] = False

    def draw(self, state: FloatArray, leader: Neighbour, index: IntArray, rng: np.random.Generator) -> FloatArray:
        """Draw habit and deviation; see ``Follower``."""
        habit = self.habit.sample(situations(state, leader, index), rng)[:, 0]
        return np.stack([habit, self.accel_bias_mps2 * rng.standard_normal(len(index))])

    def accelerations(
        self,
        state: FloatArray,
        drivers: FloatArray,
        leader: Neighbour,
        index: IntArray,
        dt_s: float,  # noqa: ARG002  the mixture was fitted to steps of one length
        rng: np.random.Generator,
    ) -> FloatArray:
        """Draw from the mixture; see ``Follower``."""
        seen = seen_by(index, state, leader, drivers[:1])
        return np.asarray(self.following.sample_columns(seen, rng)[0] + drivers[1, index])
