"""Times conditional sampling of the committed mixtures beside the bare matrix product that it can't do without."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np

from mmpf.motion.gmm.conditional import expand
from mmpf.motion.gmm.model_file import committed_mixture
from mmpf.motion.learned.lane_changer import CHANGE
from mmpf.motion.learned.short_driver import SHORT

PARTICLES = 40_000
REPETITIONS = 15


def time_mixtures(rng: np.random.Generator) -> list[dict[str, object]]:
    """Return a row for each committed mixture: the published 28 components of 5 inputs, and 60 of 14.

    Args:
        rng: Draws inputs and samples.
    """
    rows: list[dict[str, object]] = []
    for kind in (SHORT, CHANGE):
        mixture = committed_mixture(kind).mixture
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
