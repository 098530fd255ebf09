"""Times conditional sampling of the committed mixtures beside the bare matrix product that it can't do without."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import as_file, files
from time import perf_counter

import numpy as np

from mmpf.motion.gmm.conditional import ConditionalGmm, expand
from mmpf.motion.gmm.model_file import MIXTURE_PARTS, load_arrays, mixture_from_arrays
from mmpf.motion.learned.lane_changer import CASE as LANE_CHANGE
from mmpf.motion.learned.short_driver import CASE as LANE_KEEPING

PARTICLES = 40_000
REPETITIONS = 15
COMMITTED = (("lane_keeping_short.npz", LANE_KEEPING), ("lane_change.npz", LANE_CHANGE))


def time_mixtures(rng: np.random.Generator) -> list[dict[str, object]]:
    """Return a row for each committed mixture: the published 28 components of 5 inputs, and 60 of 14.

    Args:
        rng: Draws inputs and samples.
    """
    rows: list[dict[str, object]] = []
    for name, case in COMMITTED:
        mixture = _committed(name, case)
        x = rng.standard_normal((PARTICLES, mixture.inputs))
        expanded = expand(x).astype(np.float32)
        matrix = np.ascontiguousarray(mixture.logit_matrix.T, dtype=np.float32)
        product_ms, sample_ms = _medians_ms(
            lambda expanded=expanded, matrix=matrix: expanded @ matrix,  # type: ignore[misc]
            lambda mixture=mixture, x=x: mixture.sample(x, rng),  # type: ignore[misc]
        )
        rows.append({
            "components": len(mixture.weights),
            "inputs": mixture.inputs,
            "outputs": mixture.outputs,
            "particles": PARTICLES,
            "ms": sample_ms,
            "matrix_product_ms": product_ms,
        })  # fmt: skip
    return rows


def _committed(name: str, case: str) -> ConditionalGmm:
    """Return the largest mixture of a committed model file."""
    with as_file(files("mmpf.models").joinpath(name)) as path:
        arrays = load_arrays(path, case)
        prefixes = [key.removesuffix(".weights") for key in arrays if key.endswith(f".{MIXTURE_PARTS[0]}")]
        largest = max(prefixes, key=lambda prefix: len(arrays[f"{prefix}.weights"]))
        size = (len(arrays[f"{largest}.input_mean"]), len(arrays[f"{largest}.output_mean"]))
        return mixture_from_arrays(path, arrays, largest, size).mixture


def _medians_ms(*works: Callable[[], object]) -> list[float]:
    """Return the median wall time of each work, done in turns after one warm-up."""
    took_ms: list[list[float]] = [[] for _ in works]
    for repetition in range(REPETITIONS + 1):
        for place, work in enumerate(works):
            begin = perf_counter()
            work()
            if repetition:
                took_ms[place].append(1e3 * (perf_counter() - begin))
    return [float(np.median(values)) for values in took_ms]
