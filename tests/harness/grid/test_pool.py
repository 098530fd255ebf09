"""How well worker processes share the work."""

from __future__ import annotations

import os
import statistics
from time import perf_counter

import pytest

from harness.grid.grid import GridRequest, plan_grid
from harness.grid.pool import run_cells


def seconds(workers: int, request: GridRequest) -> float:
    """Return how long a grid takes, and fail if a run does."""
    rows = []
    begin = perf_counter()
    run_cells(plan_grid(request).cells, workers, None, lambda key, row: rows.append(row))
    taken = perf_counter() - begin
    assert all(row["succeeded"] for row in rows)
    return taken


@pytest.mark.slow
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core: nothing can be shared")
@pytest.mark.skipif(os.getloadavg()[0] > 0.7, reason="the machine has other work, which would share its cores")
def test_two_workers_do_a_grid_at_least_1_7_times_as_fast_as_one():
    request = GridRequest(densities="40", seeds="8", models="cvm,cam", duration_s=10.0)
    seconds(2, GridRequest(densities="40", seeds="2", models="cvm,cam", duration_s=1.0))  # kernels compiled, files read
    pairs = [(seconds(1, request), seconds(2, request)) for _ in range(2)]
    assert statistics.median(one / two for one, two in pairs) >= 1.7
