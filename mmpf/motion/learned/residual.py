"""A follower: IDM plus a small network's correction and autocorrelated noise.

The network sees the situation, the headway that the driver had when it was drawn, and normal numbers of which one stays
for good and the others change over seconds: different drivers, and what no situation explains. It was fitted to the
spread of whole rollouts (``harness.lab.fit.unrolled``), so that particles come apart as vehicles do.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from mmpf.motion.idm import IdmParameters
from mmpf.motion.learned.features import SITUATION_SIZE, log_headway
from mmpf.motion.learned.follower import follows, seen_by, situations
from mmpf.motion.learned.network_file import read_network
from mmpf.motion.protocol import Neighbour
from mmpf.motion.state import SPEED
from mmpf.numerics.arrays import Float32Array, FloatArray, IntArray
from mmpf.numerics.kernels import kernel, part_of_kernel
from mmpf.numerics.normals import standard_normals
from mmpf.numerics.products import multiply
from mmpf.numerics.threads import in_shares

CASE = "residual"
FITTED_STEP_S = 0.1
TIME_SCALES_S = (np.inf, 4.0, 1.0)
"""How long the rows of noise last: a driver's own one for good."""
SEEN = SITUATION_SIZE + 1
INPUTS = SEEN + len(TIME_SCALES_S)
USUAL_DRIVER = IdmParameters(30.0, 1.38, 1.4, 1.5, standstill_gap_m=3.0)
"""The driver that the network corrects."""
IDM_RANGE_MPS2 = (-5.0, 3.0)
STRONGEST_LEADER_MPS2 = (-6.0, 4.0)
BLOCK = 2048


class NetworkWeights(NamedTuple):
    """Two hidden layers of h units, x / (1 + |x|), over standardised inputs held to the training range.

    Attributes:
        low: Least situation and headway in training, shape (6,).
        high: Greatest ones, shape (6,).
        mean: Their means, shape (6,).
        scale: Their standard deviations, shape (6,).
        w1: Weights of the first layer, shape (9, h).
        b1: Its shifts, shape (h,).
        w2: Weights of the second layer, shape (h, h).
        b2: Its shifts, shape (h,).
        w3: Weights of the output, m/s², shape (h,).
        b3: Its shift, shape (1,).
        lag: Share by which acceleration approaches what is wanted in a step, shape (1,).
    """

    low: Float32Array
    high: Float32Array
    mean: Float32Array
    scale: Float32Array
    w1: Float32Array
    b1: Float32Array
    w2: Float32Array
    b2: Float32Array
    w3: Float32Array
    b3: Float32Array
    lag: Float32Array


@dataclass(frozen=True)
class ResidualFollower:
    """See the module; a driver is its headway's logarithm and the rows of noise.

    Attributes:
        network: What was fitted.
    """

    network: NetworkWeights
    latent_size: ClassVar[int] = 1 + len(TIME_SCALES_S)
    drives_alone: ClassVar[bool] = True

    def draw(self, state: FloatArray, leader: Neighbour, index: IntArray, rng: np.random.Generator) -> FloatArray:
        """Take the present headway, the usual one without a leader, and draw the noise; see ``Follower``."""
        headway = log_headway(np.exp(situations(state, leader, index)[:, 0]), state[SPEED, index])
        headway = np.where(follows(leader.take(index)), headway, self.network.mean[-1])
        return np.vstack([headway, standard_normals(rng, (len(TIME_SCALES_S), len(index)))])

    def accelerations(
        self,
        state: FloatArray,
        drivers: FloatArray,
        leader: Neighbour,
        index: IntArray,
        dt_s: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return what the network makes of the situation and let the noise go on; see ``Follower``."""
        seen = inputs_of(index, state, leader, drivers)
        accel = np.empty(len(index))
        lag = lag_of_step(self.network.lag, dt_s)
        in_shares(lambda begin, end: _forward(begin, end, seen, self.network, lag, accel), len(index), 20.0, BLOCK)
        let_noise_go_on(drivers[1:], dt_s, rng)
        return accel


def inputs_of(index: IntArray, state: FloatArray, leader: Neighbour, drivers: FloatArray) -> Float32Array:
    """Return what ``seen_by`` does, with no leader's acceleration out of bounds."""
    seen = seen_by(index, state, leader, drivers)
    np.clip(seen[SITUATION_SIZE - 1], *STRONGEST_LEADER_MPS2, out=seen[SITUATION_SIZE - 1])
    return seen


def lag_of_step(lag: Float32Array, dt_s: float) -> float:
    """Return the share by which acceleration approaches what is wanted in a step of any length."""
    return float(1.0 - (1.0 - float(lag[0])) ** (dt_s / FITTED_STEP_S))


def let_noise_go_on(rows: FloatArray, dt_s: float, rng: np.random.Generator) -> None:
    """Move the rows of noise one step on, in place; each keeps its spread."""
    for row, scale_s in zip(rows, TIME_SCALES_S, strict=True):
        kept = np.exp(-dt_s / scale_s)
        if kept < 1.0:
            _go_on(row, kept, np.sqrt(1.0 - kept**2), standard_normals(rng, row.shape))


@kernel()
def _go_on(row: FloatArray, kept: float, std: float, normal: Float32Array) -> None:
    for n in range(len(row)):
        row[n] = row[n] * kept + std * normal[n]


_USUAL = tuple(np.float32(value) for value in vars(USUAL_DRIVER).values())


def _forward(begin: int, end: int, seen: Float32Array, network: NetworkWeights, lag: float, accel: FloatArray) -> None:
    """Write the accelerations of the columns ``begin`` to ``end`` of ``seen``, shape (9, k)."""
    scaled = np.vstack([network.w1[:SEEN] / network.scale[:, None], network.w1[SEEN:]]).T
    weights = np.ascontiguousarray(scaled), np.ascontiguousarray(network.w2.T), network.w3[None]
    _forward_in_blocks(begin, end, seen, network, weights, np.float32(lag), accel)


@kernel(fastmath=True)
def _forward_in_blocks(
    begin: int,
    end: int,
    seen: Float32Array,
    network: NetworkWeights,
    weights: tuple[Float32Array, Float32Array, Float32Array],
    lag: np.float32,
    accel: FloatArray,
) -> None:
    for start in range(begin, end, BLOCK):
        block = seen[:, start : min(start + BLOCK, end)]
        size = block.shape[1]
        inputs, added = np.empty((INPUTS, size), dtype=np.float32), np.empty((1, size), dtype=np.float32)
        first = np.empty((len(network.b1), size), dtype=np.float32)
        second = np.empty((len(network.b2), size), dtype=np.float32)
        for row in range(SEEN):
            low, high, mean = network.low[row], network.high[row], network.mean[row]
            for n in range(size):
                inputs[row, n] = min(max(block[row, n], low), high) - mean
        for row in range(SEEN, INPUTS):
            for n in range(size):
                inputs[row, n] = block[row, n]
        multiply(weights[0], inputs, first)
        multiply(weights[1], _units(first, network.b1), second)
        multiply(weights[2], _units(second, network.b2), added)
        approach(block, added[0], network.b3[0], lag, accel[start : start + size])


@part_of_kernel(fastmath=True)
def _units(sums: Float32Array, shift: Float32Array) -> Float32Array:
    """Return what units make of the weighted sums of their inputs, shape (h, n), which is rewritten."""
    for j in range(len(sums)):
        for n in range(sums.shape[1]):
            moved = sums[j, n] + shift[j]
            sums[j, n] = moved / (np.float32(1.0) + abs(moved))
    return sums


@part_of_kernel(fastmath=True)
def approach(seen: Float32Array, added: Float32Array, shift: np.float32, lag: np.float32, accel: FloatArray) -> None:
    """Write accelerations, shape (n,), that approach those of IDM and what is added to them."""
    free_speed, headway, strongest, comfortable, _, standstill = _USUAL
    braking, zero, one = np.float32(2.0) * np.sqrt(strongest * comfortable), np.float32(0.0), np.float32(1.0)
    low, high = np.float32(IDM_RANGE_MPS2[0]), np.float32(IDM_RANGE_MPS2[1])
    per_gap = np.empty(len(added), dtype=np.float32)
    for n in range(len(added)):
        per_gap[n] = np.exp(-seen[0, n])
    for n in range(len(added)):
        speed, square = seen[1, n], (seen[1, n] / free_speed) * (seen[1, n] / free_speed)
        wanted_gap = standstill + max(speed * (headway + seen[3, n] / braking), zero)
        share = wanted_gap * per_gap[n]
        usual = min(max(strongest * (one - square * square - share * share), low), high)
        accel[n] = seen[2, n] + lag * (usual + added[n] + shift - seen[2, n])


def load_residual(path: Path) -> ResidualFollower:
    """Read a fitted network; ``ModelFileError`` says that the file can't be used."""
    return ResidualFollower(NetworkWeights(**read_network(path, CASE, "b1", _shapes)))


def _shapes(hidden: int) -> dict[str, tuple[int, ...]]:
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("low", "high", "mean", "scale"), (SEEN,))
    shapes |= {"w1": (INPUTS, hidden), "b1": (hidden,), "w2": (hidden, hidden), "b2": (hidden,), "w3": (hidden,)}
    return shapes | {"b3": (1,), "lag": (1,)}
