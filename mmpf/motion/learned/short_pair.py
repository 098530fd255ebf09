"""The paper's two short-term models as one model for traffic at large.

The paper shows each on vehicles that are known to keep their lane (28 components) or to change it (60 components) and
leaves open how a tracker that is told neither comes by them. Here each particle keeps its lane by the one until it
means to leave it, and changes by the other until it has arrived.
"""

from dataclasses import dataclass, field

import numpy as np

from mmpf.motion.learned.driver import LearnedDriver
from mmpf.motion.learned.lane_changer import LaneChanger
from mmpf.motion.learned.lane_keeping import LaneKeeper
from mmpf.motion.learned.short_driver import short_term_driver
from mmpf.motion.protocol import MotionModel, Surroundings
from mmpf.motion.state import LAT
from mmpf.numerics.arrays import FloatArray


@dataclass(frozen=True)
class ShortTermPair:
    """Lane keeping and lane change by the paper's own models; latents are a particle's lane-change intention.

    Attributes:
        keeping: Moves particles that keep their lane.
        changer: Moves particles that are changing lanes.
        rates: How often drivers take up lane changes, counted in the training traffic as for ``gmm``.
        name: Name in the registry.
        latent_size: Intention (-1 to the right, 0, 1 to the left) and lateral position of the lane it is after.
    """

    keeping: MotionModel = field(default_factory=short_term_driver)
    changer: LaneChanger = field(default_factory=LaneChanger)
    rates: LaneKeeper = field(default_factory=lambda: LearnedDriver().model.keeper)
    name: str = "gsm"
    latent_size: int = 2

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Return latents of particles that keep their lane, shape (2, n) of zeros."""
        return np.zeros((2, state.shape[1]))

    def propagate(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Sample the states one step later; see ``MotionModel.propagate``."""
        aims = latents.copy()
        self.rates.switch_intentions(state[LAT], aims, surroundings, dt_s, rng)
        after, _ = self.keeping.propagate(state, latents[:0], surroundings, dt_s, rng)
        changing = np.flatnonzero(aims[0])
        if len(changing):
            after[:, changing] = self.changer.move_some(state, aims, surroundings, changing, dt_s, rng)
        return after, aims

    def log_prior_over_tried(
        self, latents: FloatArray, after: FloatArray, surroundings: Surroundings, dt_s: float
    ) -> FloatArray:
        """Return what it says of weights that particles in sight change lanes more often; see ``TriesMore``."""
        return self.rates.log_prior_over_tried(latents, after, surroundings, dt_s)
