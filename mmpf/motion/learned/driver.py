"""The learned driver: car following by a fitted model, latent driver parameters, and lane changes.

Beside the paper's short-term model, this one is taught to recover from its own mistakes (``harness.lab.fit.recovery``),
puts out the acceleration alone, and gives each particle a driver: constants drawn once, from what the data says of a
driver in the particle's situation. They carry the uncertainty that step-by-step noise would average away, and as they
are resampled with the particle, the filter learns each vehicle's driver while it is seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import ClassVar

import numpy as np

from mmpf.motion.gmm.model_file import (
    ModelFileError,
    committed_file,
    load_arrays,
    mixture_arrays,
    mixture_from_arrays,
    save_arrays,
)
from mmpf.motion.learned import empirical, recurrent, residual
from mmpf.motion.learned.follower import Follower, MixtureFollower, follows
from mmpf.motion.learned.kernel import FreeDriving, drive
from mmpf.motion.learned.lane_changer import LaneChanger
from mmpf.motion.learned.lane_keeping import LaneKeeper
from mmpf.motion.protocol import Surroundings, propagate_by_rewriting
from mmpf.motion.state import ACCEL, LAT, SPEED
from mmpf.motion.turning import turning_driver
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.numerics.normals import standard_normals
from mmpf.numerics.threads import in_shares

CASE = "lane-keeping"
REDRAWN_PER_S = 0.2

KNOWN, DESIRED_SPEED, PACE, OFFSET, INTENTION, TARGET, HABIT = range(7)
# Here the follower's own rows begin.
FOLLOWER = HABIT
# Of drivers on a map so many desire what the road lets them go; the others go on as they do, and no faster than that.
BY_ROAD_SHARE = 0.5
SLOWEST_PACE = 0.3
# Where no map states how fast one may go, a leader that is farther ahead than this, at a walking pace or more, says
# nothing of its follower's speed.
FOLLOWED_WITHIN_S, WALKING_MPS = 4.0, 3.0
# There vehicles without a leader gain as much speed in 3 s as if their acceleration over the last second faded with
# this time constant: 2.2 s [1.3, 3.5], a regression over 246 windows of 100 vehicles on Lankershim Boulevard and
# Peachtree Street (NGSIM, US DOT, in CommonRoad's clips; positions smoothed over 0.5 s as by Thiemann et al. 2008).
FADES_IN_S = 2.2


@dataclass(frozen=True)
class FreeDriver:
    """How a driver without a leader regulates its speed towards the one it desires.

    Attributes:
        lag_per_s: Rate at which acceleration approaches what is wanted.
        gain_per_s: Wanted acceleration per m/s of missing speed.
        accel_noise_mps2: Standard deviation of the acceleration's noise in each step, for steps of 0.1 s.
        desired_per_accel_s: How much more than the present speed is desired per m/s² of present acceleration.
        desired_spread_mps: Standard deviation of the desired speed given present speed and acceleration.
    """

    lag_per_s: float
    gain_per_s: float
    accel_noise_mps2: float
    desired_per_accel_s: float
    desired_spread_mps: float

    def driving(self, dt_s: float) -> FreeDriving:
        """Return what one step needs; accelerations spread alike at any length of the step (an AR(1) process)."""

        def variance_share(step_s: float) -> float:
            return 1.0 - (1.0 - min(max(self.lag_per_s, 1e-6) * step_s, 1.0)) ** 2

        ratio = variance_share(dt_s) / variance_share(residual.FITTED_STEP_S)
        noise_mps2 = self.accel_noise_mps2 * float(np.sqrt(ratio))
        approach = min(self.lag_per_s * dt_s, 1.0)
        return FreeDriving(approach, self.gain_per_s, noise_mps2, turning_driver().strongest_mps2)


@dataclass(frozen=True)
class DriverModel:
    """All that is fitted for the learned driver.

    Attributes:
        follower: Driving behind a leader.
        free: Driving without a leader.
        keeper: Lateral motion.
    """

    follower: Follower
    free: FreeDriver
    keeper: LaneKeeper


@cache
def _committed_model() -> DriverModel:
    with committed_file(CASE) as path:
        return load_driver_model(path)


@dataclass(frozen=True)
class LearnedDriver:
    """Learned driver model; latents are its habits and its lane-change intention.

    Their rows: whether they are drawn yet, desired speed, pace (its speed against what the road lets it go), place in
    the lane, intention (-1 to the right, 0, 1 to the left), lateral position of the lane it is after, and the
    follower's own.

    Attributes:
        model: What was fitted.
        changer: Moves particles that are changing lanes.
        changes_lanes: Whether particles may take up lane changes.
        goes_on: Whether who has no leader goes on as it does, its acceleration fading, since nothing is known of the
            speed that it desires; roads only slow it down.
        name: Name in the registry.
        spreads_speed: Its accelerations are drawn, with each driver's habits, as widely as they were recorded; see
            ``mmpf.motion.protocol.spreads_speed``.
    """

    model: DriverModel = field(default_factory=_committed_model)
    changer: LaneChanger = field(default_factory=LaneChanger)
    changes_lanes: bool = True
    goes_on: bool = False
    name: str = "gmm"
    spreads_speed: ClassVar[bool] = True

    @property
    def latent_size(self) -> int:
        """Rows of latents."""
        return FOLLOWER + self.model.follower.latent_size

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Return latents that are drawn at the first step, when the surroundings are known: all zeros."""
        return np.zeros((self.latent_size, state.shape[1]))

    propagate = propagate_by_rewriting

    def rewrite(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Sample the states one step later; see ``RewritesLatents``."""
        self._draw_drivers(state, latents, surroundings, dt_s, rng)
        leader = surroundings.leader
        followed = follows(leader)
        road_speed = latents[PACE] * surroundings.road_speed_mps
        if self.goes_on:
            followed &= leader.gap_m < FOLLOWED_WITHIN_S * np.maximum(state[SPEED], WALKING_MPS)
            road_speed[road_speed > state[SPEED]] = np.inf
        elif self.model.follower.drives_alone:
            followed |= np.isinf(surroundings.road_speed_mps)
        keeps_lane = latents[INTENTION] == 0.0
        followers = np.flatnonzero(followed & keeps_lane)
        after = np.empty_like(state)
        drivers = latents[FOLLOWER:]
        sampled = self.model.follower.accelerations(state, drivers, leader, followers, dt_s, rng)
        normal = standard_normals(rng, (2, state.shape[1]))
        free, holding = self.model.free.driving(dt_s), self.model.keeper.holding(dt_s)

        own = latents[DESIRED_SPEED], road_speed, latents[OFFSET], surroundings.lane_right_m, surroundings.lane_left_m
        ahead, how = (leader.gap_m, leader.speed_mps), (free, holding)

        def drive_some(begin: int, end: int) -> None:
            first, last = np.searchsorted(followers, (begin, end))
            drive(begin, end, first, last, state, after, *own, followers, sampled, *ahead, normal, *how, dt_s)

        in_shares(drive_some, state.shape[1])
        changing = np.flatnonzero(~keeps_lane)
        if len(changing):
            after[:, changing] = self.changer.move_some(
                state, latents[INTENTION:HABIT], surroundings, changing, dt_s, rng
            )
        return after

    def without_limits(self) -> LearnedDriver:
        """Return the driver of whose desired speed nothing is known; see ``DrivesByLimits``."""
        fading = replace(self.model.free, lag_per_s=1.0 / FADES_IN_S)
        return replace(self, goes_on=True, model=replace(self.model, free=fading))

    def log_prior_over_tried(
        self, latents: FloatArray, after: FloatArray, surroundings: Surroundings, dt_s: float
    ) -> FloatArray:
        """Return what it says of weights that particles in sight change lanes more often; see ``TriesMore``."""
        if not self.changes_lanes:
            return np.zeros(latents.shape[1])
        return self.model.keeper.log_prior_over_tried(
            latents[INTENTION:HABIT], after[INTENTION:HABIT], surroundings, dt_s
        )

    def _draw_drivers(
        self, state: FloatArray, drawn: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> None:
        """Write a driver into latents that have none, now and then a fresh one into those of vehicles in sight."""
        fresh = drawn[KNOWN] == 0.0
        fresh |= ~surroundings.is_hidden & (rng.random(len(fresh), dtype=np.float32) < REDRAWN_PER_S * dt_s)
        index = np.flatnonzero(fresh)
        if len(index):
            drawn[KNOWN, index] = 1.0
            driver = self.model.follower.draw(state, surroundings.leader, index, rng)
            drawn[FOLLOWER : FOLLOWER + len(driver), index] = driver
            own = state.take(index, axis=1)
            drawn[DESIRED_SPEED, index] = self._desired_speed(own, rng)
            drawn[PACE, index] = 1.0
            self._draw_by_road(drawn, index[np.isfinite(surroundings.road_speed_mps[index])], rng)
            drawn[OFFSET, index] = self.model.keeper.draw_offset(own[LAT], surroundings, index, rng)
        if self.changes_lanes:
            self.model.keeper.switch_intentions(state[LAT], drawn[INTENTION:], surroundings, dt_s, rng)

    def _draw_by_road(self, drawn: FloatArray, index: IntArray, rng: np.random.Generator) -> None:
        """Draw how drivers on a map drive by it, in place."""
        if not len(index):
            return
        by_map = turning_driver()
        pace = by_map.pace + by_map.pace_spread * rng.standard_normal(len(index))
        drawn[PACE, index] = np.maximum(pace, SLOWEST_PACE)
        drawn[DESIRED_SPEED, index[rng.random(len(index)) < BY_ROAD_SHARE]] = np.inf

    def _desired_speed(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        if self.goes_on:
            return np.full(state.shape[1], np.inf)
        free = self.model.free
        expected = state[SPEED] + free.desired_per_accel_s * state[ACCEL]
        desired = expected + free.desired_spread_mps * rng.standard_normal(state.shape[1])
        return np.asarray(np.maximum(desired, 0.0))


def residual_driver(path: Path | None = None) -> LearnedDriver:
    """Return IDM car following plus a learned network, bundled or from a file; see ``residual``."""
    return _from_file(residual.load_residual, residual.CASE, path)


def recurrent_driver(path: Path | None = None) -> LearnedDriver:
    """Return IDM car following plus a network with a memory, bundled or from a file; see ``recurrent``."""
    return _from_file(recurrent.load_recurrent, recurrent.CASE, path)


def empirical_driver(path: Path | None = None) -> LearnedDriver:
    """Return a driver that samples recorded accelerations, bundled or from a file; see ``empirical``."""
    return _from_file(empirical.load_empirical, empirical.CASE, path)


def _from_file(load: Callable[[Path], Follower], case: str, path: Path | None) -> LearnedDriver:
    """Return a driver, from its bundled file if there is no path; raise ``ModelFileError`` if it can't be used."""
    if path is not None:
        return with_follower(load(path), case)
    with committed_file(case) as committed:
        return with_follower(load(committed), case)


def with_follower(follower: Follower, name: str) -> LearnedDriver:
    """Return a learned driver that follows in another way, and does all else as the committed one."""
    return LearnedDriver(replace(_committed_model(), follower=follower), name=name)


def load_learned_driver(path: Path) -> LearnedDriver:
    """Read a fitted model of the user's own; ``ModelFileError`` says that the file can't be used."""
    return LearnedDriver(load_driver_model(path))


def load_driver_model(path: Path) -> DriverModel:
    """Read what was fitted.

    Raises:
        ModelFileError: The file can't be used.
    """
    arrays = load_arrays(path, CASE)
    sizes = {"free": 5, "lateral": 4, "intention": 2, "spread": 1}
    for name, size in sizes.items():
        if name not in arrays or arrays[name].shape != (size,):
            raise ModelFileError(f"model file {path}: {name} must be {size} numbers")
    return DriverModel(
        MixtureFollower(
            following=mixture_from_arrays(path, arrays, "following", (6, 1)),
            habit=mixture_from_arrays(path, arrays, "habit", (5, 1)),
            accel_bias_mps2=float(arrays["spread"][0]),
        ),
        free=FreeDriver(*arrays["free"].tolist()),
        keeper=LaneKeeper(*arrays["lateral"].tolist(), *arrays["intention"].tolist()),
    )


def save_driver(path: Path, model: DriverModel, follower: MixtureFollower) -> None:
    """Write the model file of the learned driver that follows by a mixture."""
    keeper = astuple(model.keeper)
    save_arrays(
        path,
        {
            f"case.{CASE}": np.ones(1),
            **mixture_arrays("following", follower.following),
            **mixture_arrays("habit", follower.habit),
            "free": np.array(astuple(model.free)),
            "lateral": np.array(keeper[:4]),
            "intention": np.array(keeper[4:]),
            "spread": np.array([follower.accel_bias_mps2]),
        },
    )
