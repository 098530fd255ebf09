"""A follower that draws accelerations from recorded drivers in the same situation.

As in the data-driven car-following models that resample recorded accelerations: the situation falls into a cell by gap,
speed, closing speed and acceleration, and the change of acceleration until the next step is drawn from the quantiles of
that cell's recorded changes.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from mmpf.motion.gmm.model_file import ModelFileError, load_arrays, save_arrays
from mmpf.motion.learned.follower import seen_by
from mmpf.motion.protocol import Neighbour
from mmpf.motion.state import ACCEL
from mmpf.numerics.arrays import Float32Array, FloatArray, IntArray

CASE = "empirical"
BINNED = ("log_gap", "speed", "closing", "accel")
"""What cells are made by, in the order of the table's axes."""
_PLACE_IN_SITUATION = (0, 1, 3, 2)


@dataclass(frozen=True)
class EmpiricalFollower:
    """See the module; its drivers have nothing of their own.

    Attributes:
        edges: Inner edges of the cells along each axis, ascending.
        changes_mps2: Quantiles of the change of acceleration in each cell, at even distances from 0 to 1, shape (cells
            along each of the four axes, quantiles).
    """

    edges: tuple[FloatArray, ...]
    changes_mps2: FloatArray
    latent_size: ClassVar[int] = 0
    drives_alone: ClassVar[bool] = False

    def cells(self, situations: FloatArray | Float32Array) -> IntArray:
        """Return the cell of each situation, shape (5, k) to (k,): a row of the table without its four axes."""
        places = [
            np.searchsorted(edges, situations[row]) for edges, row in zip(self.edges, _PLACE_IN_SITUATION, strict=True)
        ]
        return np.asarray(np.ravel_multi_index(tuple(places), self.changes_mps2.shape[:-1]))

    def draw(self, state: FloatArray, leader: Neighbour, index: IntArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Return no rows; see ``Follower``."""
        return np.empty((0, len(index)))

    def accelerations(
        self,
        state: FloatArray,
        drivers: FloatArray,
        leader: Neighbour,
        index: IntArray,
        dt_s: float,  # noqa: ARG002  the table is of steps of one length
        rng: np.random.Generator,
    ) -> FloatArray:
        """Draw changes of acceleration from the cells' quantiles, linear in between; see ``Follower``."""
        rows = self.changes_mps2.reshape(-1, self.changes_mps2.shape[-1])
        cell = self.cells(seen_by(index, state, leader, drivers[:0]))
        level = rng.random(len(index), dtype=np.float32) * (rows.shape[1] - 1)
        below = level.astype(np.int64)
        share = level - below
        change = (1.0 - share) * rows[cell, below] + share * rows[cell, below + 1]
        return np.asarray(state[ACCEL, index] + change)


def save_empirical(path: Path, follower: EmpiricalFollower) -> None:
    """Write a table's file."""
    edges = {f"edges.{name}": values for name, values in zip(BINNED, follower.edges, strict=True)}
    save_arrays(path, {f"case.{CASE}": np.ones(1), **edges, "changes": follower.changes_mps2})


def load_empirical(path: Path) -> EmpiricalFollower:
    """Read a table back; ``ModelFileError`` says that the file can't be used."""
    arrays = load_arrays(path, CASE)
    names = [f"edges.{name}" for name in BINNED]
    if any(name not in arrays or arrays[name].ndim != 1 or (np.diff(arrays[name]) <= 0.0).any() for name in names):
        raise ModelFileError(f"model file {path}: {', '.join(names)} must each be ascending numbers")
    edges, changes = tuple(arrays[name] for name in names), arrays.get("changes", np.zeros(0))
    cells = tuple(len(along) + 1 for along in edges)
    if changes.shape[:-1] != cells or changes.shape[-1] < 2 or (np.diff(changes) < 0.0).any():
        raise ModelFileError(f"model file {path}: changes must ascend in each of one cell more than edges on each axis")
    return EmpiricalFollower(edges, changes)
