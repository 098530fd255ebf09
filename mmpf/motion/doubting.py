"""A latent of each particle that says whether it reacts to a leader that may be a false object.

Particles that react to it brake, the others drive on. If the real vehicle does not brake, its detections favour the
particles that do not react. Resampling copies the latent, so their copies keep driving on while the vehicle is hidden.
"""

from dataclasses import dataclass

import numpy as np

from mmpf.motion.protocol import AroundAnother, Surroundings, propagate_by_rewriting, step_in_place
from mmpf.numerics.arrays import FloatArray

DOUBT = -1
"""Row of the latents, from the end: the particle reacts to objects whose probability of being a vehicle exceeds it."""
REDRAWN_PER_S = 0.2
"""Rate at which particles of a vehicle in sight redraw the latent, because the leader may have changed."""


@dataclass(frozen=True)
class Doubting(AroundAnother):
    """A motion model with a latent doubt of the leader; see ``mmpf.motion.protocol.MotionModel``.

    Attributes:
        inner: How a vehicle moves.
    """

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Draw the inner model's latents, and doubts evenly from 0 to 1."""
        return np.vstack([self.inner.draw_latents(state, rng), rng.random((1, state.shape[1]))])

    propagate = propagate_by_rewriting

    def rewrite(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Move the particles by the inner model; some particles of vehicles in sight redraw their doubt."""
        moved = step_in_place(self.inner, state, latents[:DOUBT], surroundings, dt_s, rng)
        change, drawn = rng.random((2, state.shape[1]), dtype=np.float32)
        anew = np.flatnonzero(~surroundings.is_hidden & (change < -np.expm1(-dt_s * REDRAWN_PER_S)))
        latents[DOUBT, anew] = drawn[anew]
        return moved
