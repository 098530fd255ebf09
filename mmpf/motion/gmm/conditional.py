"""A Gaussian mixture over inputs and outputs, conditioned on the inputs: equations (13) to (18) of the paper.

Log-weights are quadratic in the input, so those of all components are one product of the expanded input
``[1, x, x_i x_j (i <= j)]`` with a fixed matrix; conditional means are linear in the input.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mmpf.motion.gmm.kernel import BLOCK, Conditional, Scaling, draw_outputs
from mmpf.numerics.arrays import Float32Array, FloatArray
from mmpf.numerics.normals import standard_normals
from mmpf.numerics.threads import in_shares


class InvalidMixtureError(ValueError):
    """Weights, means and covariances that make no Gaussian mixture."""


@dataclass(frozen=True)
class ConditionalGmm:
    """A joint Gaussian mixture of k components over p inputs followed by q outputs.

    Attributes:
        weights: Component weights, positive with sum one, shape (k,).
        means: Joint means, shape (k, p + q).
        covariances: Joint covariances, shape (k, p + q, p + q).
        inputs: Number p of inputs.

    Raises:
        InvalidMixtureError: Shapes disagree, a number is not finite, weights are no distribution or a covariance is
            not positive definite.
    """

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray
    inputs: int

    def __post_init__(self) -> None:
        _check(self.weights, self.means, self.covariances, self.inputs)

    @property
    def outputs(self) -> int:
        """Number q of outputs."""
        return int(self.means.shape[1]) - self.inputs

    def log_weights(self, x: FloatArray) -> FloatArray:
        """Return the logarithms of the conditional weights (18) for inputs of shape (n, p): shape (n, k)."""
        logits = expand(x) @ self.logit_matrix.T
        logits -= logits.max(axis=1, keepdims=True)
        return np.asarray(logits - np.log(np.exp(logits).sum(axis=1, keepdims=True)))

    def component_means(self, x: FloatArray) -> FloatArray:
        """Return each component's conditional mean (16) for inputs of shape (n, p): shape (n, k, q)."""
        return np.asarray(self.bias + np.einsum("kqp,np->nkq", self.slope, x))

    def mean(self, x: FloatArray) -> FloatArray:
        """Return the mean of the conditional mixture for inputs of shape (n, p): shape (n, q)."""
        return np.asarray(np.einsum("nk,nkq->nq", np.exp(self.log_weights(x)), self.component_means(x)))

    def log_density(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the conditional log-density of outputs (n, q) given inputs (n, p): shape (n,)."""
        away = y[:, None, :] - self.component_means(x)
        white = np.einsum("kij,nkj->nki", np.linalg.inv(self.noise_factor), away)
        log_determinant = np.log(np.diagonal(self.noise_factor, axis1=1, axis2=2)).sum(axis=1)
        log_parts = self.log_weights(x) - 0.5 * (white**2).sum(axis=2) - log_determinant
        top = log_parts.max(axis=1)
        log_sum = np.log(np.exp(log_parts - top[:, None]).sum(axis=1))
        return np.asarray(top + log_sum - 0.5 * self.outputs * np.log(2.0 * np.pi))

    def sample_scaled(self, x: FloatArray | Float32Array, scaling: Scaling, rng: np.random.Generator) -> FloatArray:
        """Draw one output from the conditional mixture for each input, both in the units of the data.

        The component is drawn with weights in single precision, which moves its probabilities by about 1e-6.

        Args:
            x: Inputs, shape (p, n).
            scaling: How the mixture's units relate to the data's.
            rng: Source of randomness.

        Returns:
            Outputs, shape (q, n).
        """
        uniform = rng.random(int(x.shape[1]), dtype=np.float32)
        normal = standard_normals(rng, (self.outputs, x.shape[1]))
        drawn = np.empty((self.outputs, x.shape[1]))
        inputs = np.ascontiguousarray(x, dtype=np.float64)

        def draw(begin: int, end: int) -> None:
            draw_outputs(begin, end, inputs, scaling, self._conditional, uniform, normal, drawn)

        in_shares(draw, x.shape[1], cost=len(self.weights) / 4.0, block=BLOCK)
        return drawn

    @cached_property
    def conditional_covariances(self) -> FloatArray:
        """Conditional covariances (17), which do not depend on the input, shape (k, q, q)."""
        p = self.inputs
        return np.asarray(self.covariances[:, p:, p:] - self.slope @ self.covariances[:, :p, p:])

    @cached_property
    def slope(self) -> FloatArray:
        """Matrices of the linear conditional means, shape (k, q, p)."""
        p = self.inputs
        transposed = np.linalg.solve(self.covariances[:, :p, :p], self.covariances[:, :p, p:])
        return np.ascontiguousarray(transposed.transpose(0, 2, 1))

    @cached_property
    def bias(self) -> FloatArray:
        """Conditional means at the zero input, shape (k, q)."""
        p = self.inputs
        return np.ascontiguousarray(self.means[:, p:] - np.einsum("kqp,kp->kq", self.slope, self.means[:, :p]))

    @cached_property
    def noise_factor(self) -> FloatArray:
        """Cholesky factors of the conditional covariances, shape (k, q, q)."""
        return np.asarray(np.linalg.cholesky(self.conditional_covariances), dtype=np.float64)

    @cached_property
    def logit_matrix(self) -> FloatArray:
        """Coefficients of each component's log-weight over the expanded input, shape (k, 1 + p + p (p + 1) / 2)."""
        p = self.inputs
        precision = np.linalg.inv(self.covariances[:, :p, :p])
        centre = self.means[:, :p]
        pull = np.einsum("kij,kj->ki", precision, centre)
        log_determinant = np.linalg.slogdet(precision)[1]
        constant = np.log(self.weights) + 0.5 * (log_determinant - np.einsum("ki,ki->k", pull, centre))
        rows, columns = np.triu_indices(p)
        quadratic = np.where(rows == columns, -0.5, -1.0) * precision[:, rows, columns]
        return np.concatenate([constant[:, None], pull, quadratic], axis=1)

    @cached_property
    def _conditional(self) -> Conditional:
        logit_matrix = np.ascontiguousarray(self.logit_matrix, dtype=np.float32)
        by_output = (np.moveaxis(part, 0, -1) for part in (self.bias, self.slope, self.noise_factor))
        return Conditional(logit_matrix, *map(np.ascontiguousarray, by_output))


def expand(x: FloatArray) -> FloatArray:
    """Return ``[1, x, x_i x_j (i <= j)]`` for inputs of shape (n, p): shape (n, 1 + p + p (p + 1) / 2)."""
    rows, columns = np.triu_indices(x.shape[1])
    return np.concatenate([np.ones((len(x), 1)), x, x[:, rows] * x[:, columns]], axis=1)


def _check(weights: FloatArray, means: FloatArray, covariances: FloatArray, inputs: int) -> None:
    if weights.ndim != 1 or means.ndim != 2 or len(means) != len(weights):
        raise InvalidMixtureError(f"weights of shape {weights.shape} do not fit means of shape {means.shape}")
    size = means.shape[1]
    if covariances.shape != (len(weights), size, size):
        raise InvalidMixtureError(f"covariances have shape {covariances.shape}, not {(len(weights), size, size)}")
    if not 0 < inputs < size:
        raise InvalidMixtureError(f"{inputs} inputs leave no room for outputs among {size} variables")
    if not all(np.isfinite(part).all() for part in (weights, means, covariances)):
        raise InvalidMixtureError("a weight, mean or covariance is not finite")
    if (weights <= 0.0).any() or abs(weights.sum() - 1.0) > 1e-6:
        raise InvalidMixtureError("weights must be positive and sum to one")
    if not np.allclose(covariances, covariances.transpose(0, 2, 1)):
        raise InvalidMixtureError("a covariance is not symmetric")
    if (np.linalg.eigvalsh(covariances)[:, 0] <= 0.0).any():
        raise InvalidMixtureError("a covariance is not positive definite")
