"""Standing vehicles stay in place: nonnegative speed noise alone would let them creep forward."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mmpf.motion.protocol import AroundAnother, Surroundings, propagate_by_rewriting, step_in_place
from mmpf.motion.state import ACCEL, LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import BoolArray, FloatArray

# Who is slower than this stands, and goes on standing until it starts.
STANDS_MPS = 0.3
STARTS_PER_S = 0.5
# What stands drifts as the ego's own place does, by which detections are put on the road: m per root second.
DRIFT_STD = 0.1


def drawn_standing(speed_mps: FloatArray, dt_s: float, rng: np.random.Generator) -> BoolArray:
    """Draw which vehicles stand and do so throughout a step, shape (n,)."""
    stands = speed_mps < STANDS_MPS
    stands[stands] = rng.random(int(stands.sum())) < np.exp(-STARTS_PER_S * dt_s)
    return stands


def hold_still(moved: FloatArray, before: FloatArray, stands: BoolArray) -> None:
    """Put states of those who stand back to where they were, without speed; ``moved``, shape (6, n), is changed.

    Who starts has the speed from which nobody counts as standing any more: a step's gain of speed alone is less.
    """
    starts = (before[SPEED] < STANDS_MPS) & ~stands & (moved[SPEED] > before[SPEED])
    moved[SPEED] = np.where(starts, np.maximum(moved[SPEED], STANDS_MPS), moved[SPEED])
    for row in (LON, LAT):
        moved[row] = np.where(stands, before[row], moved[row])
    for row in (SPEED, LAT_SPEED, ACCEL):
        moved[row] = np.where(stands, 0.0, moved[row])


def drift_in_place(moved: FloatArray, stands: BoolArray, std_m: float, rng: np.random.Generator) -> None:
    """Let those who stand drift a little, all in place. A particle that never moves can't follow a vehicle."""
    index = np.flatnonzero(stands)
    lon_m, lat_m = std_m * rng.standard_normal((2, len(index)))
    moved[LON, index] += lon_m
    moved[LAT, index] += lat_m


@dataclass(frozen=True)
class Standing(AroundAnother):
    """A motion model whose standing vehicles stay in place; for roads along which they point.

    Attributes:
        inner: How a vehicle moves otherwise.
    """

    own_rows: ClassVar[int] = 0

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Draw the inner model's latents."""
        return self.inner.draw_latents(state, rng)

    propagate = propagate_by_rewriting

    def rewrite(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Move the particles by the inner model, except those that stand and go on standing."""
        moved = step_in_place(self.inner, state, latents, surroundings, dt_s, rng)
        stands = drawn_standing(state[SPEED], dt_s, rng)
        if stands.any():
            hold_still(moved, state, stands)
            drift_in_place(moved, stands, DRIFT_STD * np.sqrt(dt_s), rng)
        return moved
