"""Networks of learned followers on disk: model files whose arrays are checked before use."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from mmpf.motion.gmm.model_file import ModelFileError, load_arrays, save_arrays
from mmpf.numerics.arrays import Float32Array


def save_network(path: Path, case: str, arrays: Mapping[str, Float32Array]) -> None:
    """Write the model file of a network of one case, given its arrays by name."""
    save_arrays(path, {f"case.{case}": np.ones(1), **{name: a.astype(np.float64) for name, a in arrays.items()}})


def read_network(
    path: Path, case: str, layer: str, shapes_of: Callable[[int], Mapping[str, tuple[int, ...]]]
) -> dict[str, Float32Array]:
    """Read the arrays of a network, among them ``scale`` of its inputs and the ``lag`` of its output.

    Args:
        path: The file.
        case: What the network is for.
        layer: The array with one number for each unit.
        shapes_of: Returns the shape of each array, by name, for a number of units.

    Raises:
        ModelFileError: The file can't be used.
    """
    arrays = load_arrays(path, case)
    units = arrays[layer].size if layer in arrays else 0
    shapes = shapes_of(units)
    for name, shape in shapes.items():
        if name not in arrays or arrays[name].shape != shape or not units:
            raise ModelFileError(f"model file {path}: {name} must have the shape {shape}, with at least one unit")
    return {name: np.ascontiguousarray(arrays[name], dtype=np.float32) for name in shapes}
