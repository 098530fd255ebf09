"""A conditional Gaussian mixture in the units of its data, that never leaves the range of its training inputs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mmpf.compute.arrays import Float32Array, FloatArray
from mmpf.motion.gmm.conditional import ConditionalGmm
from mmpf.motion.gmm.kernel import Scaling


@dataclass(frozen=True)
class ScaledGmm:
    """A mixture over standardised variables and the scaling that goes with it.

    Attributes:
        mixture: Mixture over inputs and outputs of mean zero and variance one.
        input_mean: Shift of the inputs, shape (p,).
        input_scale: Scale of the inputs, shape (p,).
        output_mean: Shift of the outputs, shape (q,).
        output_scale: Scale of the outputs, shape (q,).
        input_low: Least inputs of the training data, shape (p,); smaller ones are taken for these.
        input_high: Greatest inputs of the training data, shape (p,).
    """

    mixture: ConditionalGmm
    input_mean: FloatArray
    input_scale: FloatArray
    output_mean: FloatArray
    output_scale: FloatArray
    input_low: FloatArray
    input_high: FloatArray

    def standardise(self, x: FloatArray) -> FloatArray:
        """Return inputs of shape (n, p) held to the training range and standardised."""
        return (np.clip(x, self.input_low, self.input_high) - self.input_mean) / self.input_scale

    def sample(self, x: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Draw one output of shape (q,) for each input of shape (p,): (n, p) to (n, q)."""
        return self.sample_columns(x.T, rng).T

    def sample_columns(self, x: FloatArray | Float32Array, rng: np.random.Generator) -> FloatArray:
        """Draw one output for each input, variable by variable: (p, n) to (q, n)."""
        return self.mixture.sample_scaled(x, self._scaling, rng)

    def mean(self, x: FloatArray) -> FloatArray:
        """Return the mean output for each input: (n, p) to (n, q)."""
        return self.output_mean + self.output_scale * self.mixture.mean(self.standardise(x))

    def log_density(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the log-density of outputs (n, q), in their own units, given inputs (n, p): shape (n,)."""
        standardised_y = (y - self.output_mean) / self.output_scale
        return self.mixture.log_density(self.standardise(x), standardised_y) - float(np.log(self.output_scale).sum())

    @cached_property
    def _scaling(self) -> Scaling:
        return Scaling(
            self.input_low, self.input_high, self.input_mean, self.input_scale, self.output_mean, self.output_scale
        )
