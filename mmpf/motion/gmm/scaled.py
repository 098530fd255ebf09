"""A conditional Gaussian mixture in its data's units that stays within the range of its training inputs."""

from dataclasses import dataclass

import numpy as np

from mmpf.motion.gmm.conditional import ConditionalGmm
from mmpf.motion.gmm.kernel import Scaling
from mmpf.numerics.arrays import Float32Array, FloatArray


@dataclass(frozen=True)
class ScaledGmm:
    """A mixture over standardised variables and the scaling that goes with it.

    Attributes:
        mixture: Mixture over p inputs and q outputs of mean zero and variance one.
        scaling: Shifts and scales of inputs and outputs, and the range of the training inputs.
    """

    mixture: ConditionalGmm
    scaling: Scaling

    def standardise(self, x: FloatArray) -> FloatArray:
        """Return inputs of shape (n, p) held to the training range and standardised."""
        scaling = self.scaling
        return (np.clip(x, scaling.input_low, scaling.input_high) - scaling.input_mean) / scaling.input_scale

    def sample(self, x: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Draw one output of shape (q,) for each input of shape (p,): (n, p) to (n, q)."""
        return self.sample_columns(x.T, rng).T

    def sample_columns(self, x: FloatArray | Float32Array, rng: np.random.Generator) -> FloatArray:
        """Draw one output for each input, variable by variable: (p, n) to (q, n)."""
        return self.mixture.sample_scaled(x, self.scaling, rng)

    def mean(self, x: FloatArray) -> FloatArray:
        """Return the mean output for each input: (n, p) to (n, q)."""
        return self.scaling.output_mean + self.scaling.output_scale * self.mixture.mean(self.standardise(x))

    def log_density(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the log-density of outputs (n, q), in their own units, given inputs (n, p): shape (n,)."""
        mean, scale = self.scaling.output_mean, self.scaling.output_scale
        return self.mixture.log_density(self.standardise(x), (y - mean) / scale) - float(np.log(scale).sum())
