"""Random manoeuvres: a driver may brake or accelerate for a while as no motion model predicts.

A behaviour model knows what drivers usually do. One that brakes in an emergency leaves the particles of such a model
behind, and the more of its detections they can't explain, the noisier a filter takes its sensor to be. So some
particles of each vehicle in sight always try something else, as in a jump Markov system (Blom and Bar-Shalom, IEEE TAC
1988): they hold an acceleration that is drawn at random. Particles try it more often than drivers do it, and weigh the
less (``mmpf.motion.tries``). The detections choose. Where there are none, nothing weeds out what is wrong: a manoeuvre
ends with sight, and the model goes on from the speed and acceleration that it led to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from mmpf.motion.kinematic import HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2, move_along
from mmpf.motion.protocol import (
    AroundAnother,
    Surroundings,
    propagate_by_rewriting,
    step_in_place,
    without_limits,
)
from mmpf.motion.state import ACCEL, LON, SPEED
from mmpf.motion.tries import log_prior_over_tried, log_ratio_of_begun
from mmpf.numerics.arrays import BoolArray, Float32Array, FloatArray, IntArray
from mmpf.numerics.kernels import kernel

GOLDEN_RATIO = 0.5 * (np.sqrt(5.0) - 1.0)

HOLDS = -1
"""Row of the latents, from the end: 1 where the particle holds its acceleration, 0 where the inner model drives it."""


@dataclass(frozen=True)
class Manoeuvring(AroundAnother):
    """A motion model whose vehicles at times do something else; see ``mmpf.motion.protocol.MotionModel``.

    Attributes:
        inner: How a vehicle moves otherwise.
        begin_per_s: Rate at which particles of vehicles in sight begin a manoeuvre.
        true_per_s: Rate at which drivers do.
        mean_s: Mean length of a manoeuvre in sight.
        accel_std_mps2: Standard deviation of its acceleration around the present one.
    """

    begin_per_s: float
    true_per_s: float
    mean_s: float
    accel_std_mps2: float

    def without_limits(self) -> Manoeuvring:
        """Return the same around what the inner model says; see ``DrivesByLimits``."""
        return replace(self, inner=without_limits(self.inner))

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Draw the inner model's latents; nobody begins with a manoeuvre."""
        latents = np.zeros((self.latent_size, state.shape[1]))
        latents[:HOLDS] = self.inner.draw_latents(state, rng)
        return latents

    propagate = propagate_by_rewriting

    def rewrite(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Let the inner model move the particles; those in a manoeuvre go on with their accelerations instead."""
        moved = step_in_place(self.inner, state, latents[:HOLDS], surroundings, dt_s, rng)
        change = rng.random(int(state.shape[1]), dtype=np.float32)
        ends, begins = -np.expm1(-dt_s / self.mean_s), -np.expm1(-dt_s * self.begin_per_s)
        held, begun = _choose(latents[HOLDS], surroundings.is_hidden, change, ends, begins)
        # Evenly spread, particle after particle: those of one vehicle leave no wide gap between what they try.
        even = (rng.random() + GOLDEN_RATIO * np.arange(len(begun))) % 1.0
        holding = np.concatenate([held, begun])
        accel = state[ACCEL].take(holding)
        accel[len(held) :] += self.accel_std_mps2 * ndtri(np.clip(even, 1e-9, 1.0 - 1e-9))
        np.clip(accel, -HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2, out=accel)
        end = state.take(holding, axis=1)
        move_along(end, end, accel, 0.0, dt_s)
        for row in (LON, SPEED, ACCEL):
            moved[row, holding] = end[row]
        return moved

    def log_prior_over_tried(
        self, latents: FloatArray, after: FloatArray, surroundings: Surroundings, dt_s: float
    ) -> FloatArray:
        """Return what it says of weights that particles begin manoeuvres more often; see ``TriesMore``."""
        begun = log_ratio_of_begun(
            after[HOLDS] != 0.0,
            ~surroundings.is_hidden & (latents[HOLDS] == 0.0),
            float(-np.expm1(-dt_s * self.true_per_s)),
            float(-np.expm1(-dt_s * self.begin_per_s)),
        )
        begun += log_prior_over_tried(self.inner, latents[:HOLDS], after[:HOLDS], surroundings, dt_s)
        return begun


@kernel()
def _choose(
    holds: FloatArray, is_hidden: BoolArray, change: Float32Array, ends: float, begins: float
) -> tuple[IntArray, IntArray]:
    """Return which particles go on with a manoeuvre and which begin one; ``holds``, shape (n,), is rewritten."""
    held, begun = np.empty(len(holds), dtype=np.int64), np.empty(len(holds), dtype=np.int64)
    goes_on, begin = 0, 0
    for n in range(len(holds)):
        held[goes_on] = begun[begin] = n
        did = holds[n] != 0.0
        goes_on += (not is_hidden[n]) & did & (change[n] >= ends)
        begin += (not is_hidden[n]) & (not did) & (change[n] < begins)
        holds[n] = 0.0
    for n in held[:goes_on]:
        holds[n] = 1.0
    for n in begun[:begin]:
        holds[n] = 1.0
    return held[:goes_on], begun[:begin]
