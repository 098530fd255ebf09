"""Prior update: every particle moves by one step, equations (1) and (4)."""

from dataclasses import replace
from typing import Protocol

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.motion.protocol import MotionModel, Surroundings, step_in_place
from mmpf.motion.state import ACCEL, LAT_SPEED, SPEED
from mmpf.motion.tries import log_prior_over_tried
from mmpf.numerics.arrays import BoolArray, Float32Array, FloatArray
from mmpf.numerics.kernels import kernel
from mmpf.numerics.normals import standard_normals
from mmpf.options.filter import ModelErrorOptions
from mmpf.scan import Scan
from mmpf.stages.update_rule import Situation


class Proposal(Protocol):
    """The density that new states are drawn from, f(x_k | x_{k-1}, z_k) in equation (10)."""

    def __call__(
        self,
        motion: MotionModel,
        state: FloatArray,
        latents: FloatArray,
        surroundings: Surroundings,
        scan: Scan,
        dt_s: float,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Draw the next states.

        Args:
            motion: The motion model, whose density is the prior f(x_k | x_{k-1}).
            state: Present states, shape (6, n).
            latents: Present latents, shape (latent_size, n), which may be rewritten.
            surroundings: What the particles know of road and traffic.
            scan: The scan that is about to be taken in.
            dt_s: Length of the step.
            rng: Source of randomness.

        Returns:
            Next states, next latents, and the logarithm of prior over proposal density at the states drawn, (n,).
        """


def bootstrap_proposal(
    motion: MotionModel,
    state: FloatArray,
    latents: FloatArray,
    surroundings: Surroundings,
    scan: Scan,  # noqa: ARG001  the prior looks at no measurement
    dt_s: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw from the motion model itself; see ``Proposal``.

    The ratio in equation (10) is one, but for what the model says that its particles try more often than vehicles do.
    """
    before = latents.copy()
    moved = step_in_place(motion, state, latents, surroundings, dt_s, rng)
    if not np.isfinite(moved.sum()):
        raise ValueError(f"motion model {motion.name}: propagate returned a state that is not finite")
    return moved, latents, log_prior_over_tried(motion, before, latents, surroundings, dt_s)


def prior_update(
    mixture: Mixture,
    surroundings: Surroundings,
    situation: Situation,
    proposal: Proposal,
    error: ModelErrorOptions,
    rng: np.random.Generator,
) -> Mixture:
    """Move all particles of all components one step; the log ratio of equation (10) starts the raw weights."""
    cloud, motion, dt_s = mixture.cloud, situation.motion, situation.dt_s
    state, latents, log_ratio = proposal(motion, cloud.state, cloud.latents, surroundings, situation.scan, dt_s, rng)
    _add_model_error(state, surroundings.is_hidden, dt_s, error, rng)
    np.maximum(state[SPEED], 0.0, out=state[SPEED])
    components = mixture.components.having(age_s=mixture.components.age_s + dt_s)
    moved = replace(cloud, state=state, latents=latents, log_raw_weight=cloud.log_weight + log_ratio)
    return replace(mixture, cloud=moved, components=components)


def _add_model_error(
    state: FloatArray,
    is_hidden: BoolArray,
    dt_s: float,
    error: ModelErrorOptions,
    rng: np.random.Generator,
) -> None:
    seen = np.sqrt(dt_s) * np.array([error.speed or 0.0, error.accel, error.lat_speed])
    hidden = seen * np.array([error.hidden_lon_factor, error.hidden_lon_factor, 1.0])
    if seen.any():
        normal = standard_normals(rng, (len(seen), state.shape[1]))
        _add_scaled(state, (SPEED, ACCEL, LAT_SPEED), is_hidden, seen, hidden, normal)


@kernel(fastmath=True)
def _add_scaled(
    state: FloatArray,
    rows: tuple[int, ...],
    is_hidden: BoolArray,
    seen: FloatArray,
    hidden: FloatArray,
    normal: Float32Array,
) -> None:
    for k in range(len(rows)):
        noisy, draws = state[rows[k]], normal[k]
        for n in range(len(noisy)):
            noisy[n] += (hidden[k] if is_hidden[n] else seen[k]) * draws[n]
