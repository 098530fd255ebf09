"""A follower: IDM plus the correction of a recurrent network that remembers the particle's last seconds.

A gated recurrent unit (Cho et al., EMNLP 2014) takes the situation at each step. Its memory determines what is added to
IDM's acceleration, and the factor of each row of noise. The memory is resampled with the particle.
It was fitted to the spread of whole rollouts (``harness.lab.fit.recurrent_fit``); no deep-learning library runs here.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from mmpf.motion.learned.features import SITUATION_SIZE
from mmpf.motion.learned.network_file import read_network
from mmpf.motion.learned.residual import (
    BLOCK,
    FITTED_STEP_S,
    TIME_SCALES_S,
    approach,
    inputs_of,
    lag_of_step,
    let_noise_go_on,
)
from mmpf.motion.protocol import Neighbour
from mmpf.numerics.arrays import Float32Array, FloatArray, IntArray
from mmpf.numerics.kernels import kernel
from mmpf.numerics.normals import standard_normals
from mmpf.numerics.products import product
from mmpf.numerics.threads import in_shares

CASE = "recurrent"
NOISE = len(TIME_SCALES_S)
OUTPUTS = 1 + NOISE


class RecurrentWeights(NamedTuple):
    """A gated recurrent unit of h numbers over standardised inputs held to the training range.

    Of the 3 h columns the first h are of the update gate, then come those of the reset gate and of the candidate. The
    candidate is x / (1 + |x|), the gates half of one more than that; ``spread`` makes the noise's factors positive.

    Attributes:
        low: Least situation in training, shape (5,).
        high: Greatest one, shape (5,).
        mean: Their means, shape (5,).
        scale: Their standard deviations, shape (5,).
        w: Weights of the inputs, shape (5, 3 h).
        b: Shifts beside them, shape (3 h,).
        u: Weights of the memory, shape (h, 3 h).
        c: Shift of the candidate's part that the reset gate scales, shape (h,).
        out: Weights of what is added, m/s², and of the noise's factors, shape (h, 4).
        shift: Their shifts, shape (4,).
        lag: Share by which acceleration approaches what is wanted in a step, shape (1,).
    """

    low: Float32Array
    high: Float32Array
    mean: Float32Array
    scale: Float32Array
    w: Float32Array
    b: Float32Array
    u: Float32Array
    c: Float32Array
    out: Float32Array
    shift: Float32Array
    lag: Float32Array


@dataclass(frozen=True)
class RecurrentFollower:
    """See the module; a driver is rows of noise and a memory.

    Attributes:
        network: What was fitted.
    """

    network: RecurrentWeights
    drives_alone: ClassVar[bool] = True

    @property
    def latent_size(self) -> int:
        """Rows of noise and of memory."""
        return NOISE + len(self.network.c)

    def draw(
        self,
        state: FloatArray,  # noqa: ARG002  the network sees it at the next step
        leader: Neighbour,  # noqa: ARG002
        index: IntArray,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Draw the noise, and leave the memory as it is; see ``Follower``."""
        return np.asarray(standard_normals(rng, (NOISE, len(index))), dtype=np.float64)

    def accelerations(
        self,
        state: FloatArray,
        drivers: FloatArray,
        leader: Neighbour,
        index: IntArray,
        dt_s: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return what the network makes of the situation and its memory, which takes it in; see ``Follower``."""
        seen, accel = inputs_of(index, state, leader, drivers[:0]), np.empty(len(index))

        def forward(begin: int, end: int) -> None:
            _forward(begin, end, seen, drivers, index, self.network, dt_s, accel)

        in_shares(forward, len(index), 40.0, BLOCK)
        let_noise_go_on(drivers[:NOISE], dt_s, rng)
        return accel


def _forward(
    begin: int,
    end: int,
    seen: Float32Array,
    drivers: FloatArray,
    index: IntArray,
    network: RecurrentWeights,
    dt_s: float,
    accel: FloatArray,
) -> None:
    """Write the accelerations of the columns ``begin`` to ``end`` of ``seen``, (5, k), and their drivers' memories."""
    low, high, mean = (part[:, None] for part in network[:3])
    from_inputs = (network.w / network.scale[:, None]).T
    lag, steps = np.float32(lag_of_step(network.lag, dt_s)), np.float32(dt_s / FITTED_STEP_S)
    for start in range(begin, end, BLOCK):
        some = slice(start, min(start + BLOCK, end))
        block, own = seen[:, some], drivers[:, index[some]].astype(np.float32)
        memory = own[NOISE:]
        sums = product(from_inputs, np.clip(block, low, high) - mean)
        _remember(sums, network.b, product(network.u.T, memory), network.c, steps, memory)
        said = product(network.out.T, memory)
        _accelerate(block, said, network.shift, own, lag, accel[some])
        drivers[NOISE:, index[some]] = memory


@kernel(fastmath=True)
def _remember(
    seen: Float32Array,
    shift: Float32Array,
    known: Float32Array,
    own: Float32Array,
    steps: np.float32,
    memory: Float32Array,
) -> None:
    """Take what is seen into the memory, shape (h, n), given the weighted sums of both, shape (3 h, n)."""
    units, one, half = len(memory), np.float32(1.0), np.float32(0.5)
    for j in range(units):
        for n in range(memory.shape[1]):
            update = seen[j, n] + known[j, n] + shift[j]
            update = half * (one + update / (one + abs(update)))
            reset = seen[units + j, n] + known[units + j, n] + shift[units + j]
            reset = half * (one + reset / (one + abs(reset)))
            new = seen[2 * units + j, n] + shift[2 * units + j] + reset * (known[2 * units + j, n] + own[j])
            new /= one + abs(new)
            # Nearly 1 - (1 - update)^steps: exact for a step as long as those of the fit.
            share = steps * update / (one + (steps - one) * update)
            memory[j, n] += share * (new - memory[j, n])


@kernel(fastmath=True)
def _accelerate(
    seen: Float32Array, said: Float32Array, shift: Float32Array, noise: Float32Array, lag: np.float32, accel: FloatArray
) -> None:
    """Write accelerations, given the network's outputs, (4, n): what it adds to IDM's, and the factors of the noise."""
    one = np.float32(1.0)
    for n in range(said.shape[1]):
        added = said[0, n] + shift[0]
        for k in range(1, len(said)):
            factor = said[k, n] + shift[k]
            added += noise[k - 1, n] * (one + factor if factor > np.float32(0.0) else one / (one - factor))
        said[0, n] = added
    approach(seen, said[0], np.float32(0.0), lag, accel)


def load_recurrent(path: Path) -> RecurrentFollower:
    """Read a fitted network; ``ModelFileError`` says that the file can't be used."""
    return RecurrentFollower(RecurrentWeights(**read_network(path, CASE, "c", _shapes)))


def _shapes(units: int) -> dict[str, tuple[int, ...]]:
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("low", "high", "mean", "scale"), (SITUATION_SIZE,))
    shapes |= {"w": (SITUATION_SIZE, 3 * units), "b": (3 * units,), "u": (units, 3 * units), "c": (units,)}
    return shapes | {"out": (units, OUTPUTS), "shift": (OUTPUTS,), "lag": (1,)}
