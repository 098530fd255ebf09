"""A follower that is IDM and what a small network adds to it, with noise that goes on for seconds.

The network sees the situation, the headway that the driver had when it was drawn, and normal numbers of which one stays
for good and the others change over seconds: different drivers, and what no situation explains. It was fitted to the
spread of whole rollouts (``harness.lab.fit.unrolled``), so that particles come apart as vehicles do.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from mmpf.motion.gmm.model_file import ModelFileError, load_arrays, save_arrays
from mmpf.motion.idm import IdmParameters
from mmpf.motion.learned.features import SITUATION_SIZE, log_headway
from mmpf.motion.learned.follower import FURTHEST_LEADER_M, follows, seen_by, situations
from mmpf.motion.protocol import Neighbour
from mmpf.motion.state import SPEED
from mmpf.numerics.arrays import Float32Array, FloatArray, IntArray
from mmpf.numerics.kernels import kernel
from mmpf.numerics.normals import standard_normals
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
_BLOCK = 64


class Network(NamedTuple):
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

    network: Network
    latent_size: ClassVar[int] = 1 + len(TIME_SCALES_S)
    drives_alone: ClassVar[bool] = True

    def draw(self, state: FloatArray, leader: Neighbour, index: IntArray, rng: np.random.Generator) -> FloatArray:
        """Take the present headway, the usual one without a leader, and draw the noise; see ``Follower``."""
        headway = log_headway(np.exp(situations(state, leader, index)[:, 0]), state[SPEED, index])
        headway = np.where(follows(leader)[index], headway, self.network.mean[-1])
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
        seen = seen_by(index, state, leader, INPUTS)
        alone = ~follows(leader)[index]
        seen[0, alone], seen[3, alone], seen[4, alone] = np.log(FURTHEST_LEADER_M), 0.0, 0.0
        np.clip(seen[SITUATION_SIZE - 1], *STRONGEST_LEADER_MPS2, out=seen[SITUATION_SIZE - 1])
        seen[SITUATION_SIZE:] = drivers[:, index]
        accel = np.empty(len(index))
        lag = 1.0 - (1.0 - float(self.network.lag[0])) ** (dt_s / FITTED_STEP_S)
        in_shares(lambda begin, end: _forward(begin, end, seen, self.network, lag, accel), len(index), 20.0, _BLOCK)
        for row, scale_s in enumerate(TIME_SCALES_S, start=1):
            kept = np.exp(-dt_s / scale_s)
            if kept < 1.0:
                drivers[row] = kept * drivers[row] + np.sqrt(1.0 - kept**2) * standard_normals(rng, drivers[row].shape)
        return accel


_USUAL = tuple(np.float32(value) for value in vars(USUAL_DRIVER).values())


@kernel(fastmath=True)
def usual_acceleration(log_gap: np.float32, speed: np.float32, closing: np.float32) -> np.float32:
    """Return what ``USUAL_DRIVER`` does by IDM, held to ``IDM_RANGE_MPS2``."""
    free_speed, headway, strongest, comfortable, _, standstill = _USUAL
    braking = np.float32(2.0) * np.sqrt(strongest * comfortable)
    wanted = standstill + max(speed * (headway + closing / braking), np.float32(0.0))
    share = wanted * np.exp(-log_gap)
    square = (speed / free_speed) * (speed / free_speed)
    accel = strongest * (np.float32(1.0) - square * square - share * share)
    return min(max(accel, np.float32(IDM_RANGE_MPS2[0])), np.float32(IDM_RANGE_MPS2[1]))


@kernel(fastmath=True)
def _forward(begin: int, end: int, seen: Float32Array, network: Network, lag: float, accel: FloatArray) -> None:
    """Write the accelerations of the columns ``begin`` to ``end`` of ``seen``, shape (9, k)."""
    hidden, one = network.w1.shape[1], np.float32(1.0)
    inputs = np.empty((INPUTS, _BLOCK), dtype=np.float32)
    first, second = np.empty((2, hidden, _BLOCK), dtype=np.float32)
    total = np.empty(_BLOCK, dtype=np.float32)
    for start in range(begin, end, _BLOCK):
        width = min(_BLOCK, end - start)
        for i in range(INPUTS):
            for n in range(width):
                inputs[i, n] = seen[i, start + n]
            if i < SEEN:
                low, high, mean, factor = network.low[i], network.high[i], network.mean[i], one / network.scale[i]
                for n in range(width):
                    inputs[i, n] = (min(max(inputs[i, n], low), high) - mean) * factor
        for j in range(hidden):
            _unit(inputs, network.w1[:, j], network.b1[j], width, first[j])
        total[:width] = network.b3[0]
        for j in range(hidden):
            _unit(first, network.w2[:, j], network.b2[j], width, second[j])
            weight = network.w3[j]
            for n in range(width):
                total[n] += weight * second[j, n]
        for n in range(width):
            k = start + n
            wanted = usual_acceleration(seen[0, k], seen[1, k], seen[3, k]) + total[n]
            accel[k] = seen[2, k] + lag * (wanted - seen[2, k])


@kernel(fastmath=True)
def _unit(inputs: Float32Array, weights: Float32Array, shift: np.float32, width: int, out: Float32Array) -> None:
    for n in range(width):
        out[n] = shift
    for i in range(len(inputs)):
        weight = weights[i]
        for n in range(width):
            out[n] += weight * inputs[i, n]
    for n in range(width):
        out[n] /= np.float32(1.0) + abs(out[n])


def save_residual(path: Path, network: Network) -> None:
    """Write the model file of a fitted network."""
    save_arrays(path, {f"case.{CASE}": np.ones(1), **{k: v.astype(np.float64) for k, v in network._asdict().items()}})


def load_residual(path: Path) -> ResidualFollower:
    """Read a fitted network.

    Raises:
        ModelFileError: The file can't be used.
    """
    arrays = load_arrays(path, CASE)
    hidden = arrays["b1"].size if "b1" in arrays else 0
    shapes = {"w1": (INPUTS, hidden), "b1": (hidden,), "w2": (hidden, hidden), "b2": (hidden,), "w3": (hidden,)}
    shapes |= {"b3": (1,), "lag": (1,)} | dict.fromkeys(("low", "high", "mean", "scale"), (SEEN,))
    for name, shape in shapes.items():
        if name not in arrays or arrays[name].shape != shape or not hidden:
            raise ModelFileError(f"model file {path}: {name} must have the shape {shape}, with a hidden unit at least")
    if (arrays["scale"] <= 0.0).any() or not 0.0 < arrays["lag"][0] <= 1.0:
        raise ModelFileError(f"model file {path}: scale must be above 0, and lag between 0 and 1")
    return ResidualFollower(Network(*(np.ascontiguousarray(arrays[n], dtype=np.float32) for n in Network._fields)))
