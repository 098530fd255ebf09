"""The motion model protocol: one vectorised call moves all particles of all components by one step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np

from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.registry import Entry, Registry
from mmpf.scan import BodyHeadings


class Neighbour(NamedTuple):
    """The nearest vehicle in one direction for each of n particles; arrays of shape (n,).

    Attributes:
        exists: Whether there is such a vehicle.
        gap_m: Clear distance bumper to bumper; negative if they overlap, infinite where there is none.
        speed_mps: Its longitudinal speed; the particle's own where there is none.
        accel_mps2: Its longitudinal acceleration; zero where there is none.
        length_m: Its length; that of the particle's own vehicle where there is none.
    """

    exists: BoolArray
    gap_m: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    length_m: FloatArray

    def take(self, index: IntArray) -> Neighbour:
        """Return the neighbours of some of the particles."""
        exists, gap_m, speed_mps, accel_mps2, length_m = self
        return Neighbour(exists[index], gap_m[index], speed_mps[index], accel_mps2[index], length_m[index])


class NeighbourView(Protocol):
    """What ``Neighbour`` offers; whoever implements it may work it out only when it is asked for."""

    @property
    def exists(self) -> BoolArray: ...  # noqa: D102
    @property
    def gap_m(self) -> FloatArray: ...  # noqa: D102
    @property
    def speed_mps(self) -> FloatArray: ...  # noqa: D102
    @property
    def accel_mps2(self) -> FloatArray: ...  # noqa: D102
    @property
    def length_m(self) -> FloatArray: ...  # noqa: D102

    def take(self, index: IntArray) -> Neighbour:
        """Return the neighbours of some of the particles."""


@dataclass(frozen=True)
class Surroundings:
    """What each of n particles knows of road and traffic around it; arrays of shape (n,).

    Taken from the road and from the tracker's other components, never from truth.

    Attributes:
        length_m: Length of the particle's own vehicle.
        lane_right_m: Lateral position of the own lane's right line; nan off every lane, as on a ramp.
        lane_left_m: Lateral position of the own lane's left line; nan off every lane.
        has_left_lane: Whether there is a lane to the left at this place.
        has_right_lane: Whether there is a lane to the right at this place.
        leader: Nearest vehicle ahead that is in the way; nobody off every lane.
        left_leader: Nearest vehicle ahead in the lane to the left.
        left_follower: Nearest vehicle behind in the lane to the left.
        right_leader: Nearest vehicle ahead in the lane to the right.
        right_follower: Nearest vehicle behind in the lane to the right.
        is_hidden: Whether the particle's vehicle has not been seen lately.
        road_speed_mps: How fast the road can be driven here, by limits, bends and lines ahead; infinite where nothing
            is known of them.
    """

    length_m: FloatArray
    lane_right_m: FloatArray
    lane_left_m: FloatArray
    has_left_lane: BoolArray
    has_right_lane: BoolArray
    leader: Neighbour
    left_leader: NeighbourView
    left_follower: NeighbourView
    right_leader: NeighbourView
    right_follower: NeighbourView
    is_hidden: BoolArray
    road_speed_mps: FloatArray


def offset_in_lane(lat_m: FloatArray, lane_right_m: FloatArray, lane_left_m: FloatArray) -> FloatArray:
    """Return how far left of their lane's middle positions lie, zero off every lane; all of shape (n,)."""
    centre = 0.5 * (lane_right_m + lane_left_m)
    return np.where(np.isfinite(centre), lat_m - centre, 0.0)


def take_surroundings(surroundings: Surroundings, index: IntArray) -> Surroundings:
    """Return what some of the particles know."""
    return Surroundings(*(getattr(surroundings, column.name).take(index) for column in fields(Surroundings)))


class MotionModel(Protocol):
    """Samples each particle's next state from its present one: the transition density of equation (1).

    Attributes:
        name: Name in the registry.
        latent_size: Rows of per-particle constants or modes that the model carries beside the state (a driver's
            habits, a lane-change intention). They are resampled with the particle. Zero for memoryless models.

    A model may also have ``spreads_speed``, a bool; see the function of that name for what it says. It is no member of
    this protocol, so that a model without it is a motion model all the same.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def latent_size(self) -> int: ...  # noqa: D102

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Draw the latents of newborn particles.

        Args:
            state: Their states, shape (6, n), rows as in ``mmpf.motion.state``.
            rng: Source of randomness.

        Returns:
            Latents, shape (latent_size, n).
        """

    def propagate(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Sample the states one step later; one call for all particles of all components.

        Args:
            state: Present states, shape (6, n): longitudinal and lateral position, speed and acceleration, rows as
                in ``mmpf.motion.state``. Not written to.
            latents: Present latents, shape (latent_size, n). Not written to.
            surroundings: What the particles know of road and traffic.
            dt_s: Length of the step.
            rng: Source of randomness.

        Returns:
            Next states, shape (6, n), and next latents, shape (latent_size, n). Finite, and never with a negative
            longitudinal speed, whatever the surroundings.
        """


@runtime_checkable
class RewritesLatents(Protocol):
    """A motion model that writes the latents after a step over those before it, which saves copies of them."""

    def rewrite(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return next states, shape (6, n), and rewrite the latents; otherwise as ``MotionModel.propagate``."""


def propagate_by_rewriting(
    motion: RewritesLatents,
    state: FloatArray,
    latents: FloatArray,
    surroundings: Surroundings,
    dt_s: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Sample the states one step later; see ``MotionModel.propagate``."""
    after = latents.copy()
    return motion.rewrite(state, after, surroundings, dt_s, rng), after


def step_in_place(
    motion: MotionModel,
    state: FloatArray,
    latents: FloatArray,
    surroundings: Surroundings,
    dt_s: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Return any model's next states, shape (6, n), and rewrite the latents.

    Raises:
        ValueError: The filter can't go on with what the model returned.
    """
    if isinstance(motion, RewritesLatents):
        return motion.rewrite(state, latents, surroundings, dt_s, rng)
    moved, latents[:] = checked_step(motion, motion.propagate(state, latents, surroundings, dt_s, rng), state, latents)
    return moved


@runtime_checkable
class TakesHeadings(Protocol):
    """A motion model whose newborn particles point as their vehicles were measured to point."""

    def towards(self, latents: FloatArray, headings: BodyHeadings, rng: np.random.Generator) -> FloatArray:
        """Return latents of newborn particles whose directions are drawn around measured ones.

        Args:
            latents: Latents of equally many particles for each detection, one after the other, shape (latent_size, n).
            headings: The measured directions, of shape (k,).
            rng: Source of randomness.
        """


@runtime_checkable
class DrivesByLimits(Protocol):
    """A motion model that drives otherwise where no map states a speed limit."""

    def without_limits(self) -> MotionModel:
        """Return the model for such a place."""


def without_limits(motion: MotionModel) -> MotionModel:
    """Return how a model's vehicles move where no map states a speed limit."""
    return motion.without_limits() if isinstance(motion, DrivesByLimits) else motion


@runtime_checkable
class BuildsOnAnother(Protocol):
    """A motion model whose latents begin with those of another, to which it leaves what it does not say itself."""

    inner: MotionModel


@dataclass(frozen=True)
class AroundAnother:
    """What motion models share that are built around another one: its name, and its latents before their own.

    Attributes:
        inner: The model within.
        own_rows: How many rows of latents follow those of the model within.
    """

    inner: MotionModel
    own_rows: ClassVar[int] = 1

    @property
    def name(self) -> str:
        """Name of the model within."""
        return self.inner.name

    @property
    def latent_size(self) -> int:
        """Rows of the model within, and its own."""
        return self.inner.latent_size + self.own_rows


def spreads_speed(motion: MotionModel) -> bool:
    """Return whether the model says that its own draws spread the longitudinal speed as widely as vehicles' speeds do.

    A model says so by an attribute ``spreads_speed`` that is true: particles that begin with one speed, m/s, then come
    apart by themselves from step to step, and the filter adds no noise to their speed where its update rule keeps them
    apart as well (``ModelErrorOptions.speed`` in ``mmpf.options.filter``). A model that does not say so is taken to be
    too sure of the speed. What it is called plays no part.
    """
    inner = motion.inner if isinstance(motion, BuildsOnAnother) else None
    return bool(getattr(motion, "spreads_speed", inner is not None and spreads_speed(inner)))


def checked_step(
    motion: MotionModel, moved: object, state: FloatArray, latents: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what a motion model returned, if the filter can go on with it.

    Args:
        motion: The model.
        moved: What its ``propagate`` returned.
        state: The states that it was given, shape (6, n).
        latents: The latents that it was given, shape (latent_size, n).

    Raises:
        ValueError: It can't; the message says what is wrong with it.
    """
    if not isinstance(moved, tuple) or len(moved) != 2:
        raise ValueError(f"motion model {motion.name}: propagate returned {type(moved).__name__}, not (state, latents)")
    for name, values, before in (("state", moved[0], state), ("latents", moved[1], latents)):
        if np.shape(values) != before.shape:
            shapes = f"{np.shape(values)}, not {before.shape}"
            raise ValueError(f"motion model {motion.name}: propagate returned {name} of shape {shapes}")
    return np.require(moved[0], np.float64, ["C", "W"]), moved[1]  # what kernels are compiled for


Step = Callable[[FloatArray, Surroundings, float, np.random.Generator], FloatArray]


@dataclass(frozen=True)
class Memoryless:
    """A motion model without latents, made of one function.

    Attributes:
        name: Name in the registry.
        step: A function ``(state, surroundings, dt_s, rng)`` that samples the states one step later, shape (6, n); all
            are as for ``MotionModel.propagate``.
        spreads_speed: What it says to the function of that name.
        latent_size: No latents.
    """

    name: str
    step: Step
    spreads_speed: bool = False
    latent_size: ClassVar[int] = 0

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Return no latents, shape (0, n)."""
        return np.empty((0, state.shape[1]))

    def propagate(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Sample the states one step later; see ``MotionModel.propagate``."""
        return self.step(state, surroundings, dt_s, rng), latents


class MotionModelFactory(Protocol):
    """Builds a motion model; a class with default arguments will do."""

    def __call__(self) -> MotionModel:
        """Return the model with its default parameters."""


_PLACES = {
    "cvm": "kinematic:CVM",
    "cam": "kinematic:CAM",
    "csav": "kinematic:CSAV",
    "csaa": "kinematic:CSAA",
    "idm": "idm:intelligent_driver",
    "idm-kesting-2010": "idm:IDM_KESTING_2010",
    "idm-treiber-kesting-2013": "idm:IDM_TREIBER_KESTING_2013",
    "idm-fitted": "idm:idm_fitted",
    "idm-adaptive": "idm:AdaptiveDriver",
    "gmm": "learned.driver:LearnedDriver",
    "residual": "learned.driver:residual_driver",
    "recurrent": "learned.driver:recurrent_driver",
    "empirical": "learned.driver:empirical_driver",
    "gmm-short": "learned.short_driver:short_term_driver",
    "gmm-lane-change": "learned.lane_changer:LaneChangeDriver",
    "gsm": "learned.short_pair:ShortTermPair",
}
motion_models: Registry[MotionModelFactory] = Registry(
    "motion model", "mmpf.motion_models", {name: Entry(f"mmpf.motion.{place}") for name, place in _PLACES.items()}
)
