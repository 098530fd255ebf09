"""How well worker processes share the work, and which cell each is given next."""

import os
import statistics
from time import perf_counter

import pytest

from harness.grid.grid import GridRequest, plan_grid
from harness.grid.pool import CellQueue, run_cells


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


def cells(seeds: int = 2, ranges: str = "50,60,70"):
    """Return cells of one traffic a seed, each seen by three sensors."""
    return plan_grid(GridRequest(densities="30", seeds=str(seeds), vary=(f"sensor.range_m={ranges}",))).cells


def taken(waiting: CellQueue, traffic) -> tuple[int, float]:
    config = waiting.take(traffic).config
    return config.seed, config.sensor.overrides["range_m"]


def test_each_worker_stays_with_the_traffic_that_it_began():
    grid = cells()
    waiting = CellQueue(grid)
    first, second = waiting.take(None), waiting.take(None)
    assert (first.config.seed, second.config.seed) == (0, 1)
    assert [taken(waiting, second.traffic) for _ in range(2)] == [(1, 60.0), (1, 70.0)]
    assert [taken(waiting, first.traffic) for _ in range(2)] == [(0, 60.0), (0, 70.0)]
    assert not waiting


def test_a_worker_whose_traffic_is_done_helps_with_what_others_began():
    waiting = CellQueue(cells(seeds=1))
    waiting.take(None)
    assert taken(waiting, None) == (0, 60.0)


def test_cells_of_traffic_of_their_own_are_taken_in_their_order():
    grid = plan_grid(GridRequest(densities="20,40", seeds="2")).cells
    waiting, last, order = CellQueue(grid), None, []
    while waiting:
        cell = waiting.take(last)
        last = cell.traffic
        order.append(cell)
    assert order == list(grid)


def test_a_cell_whose_worker_died_comes_first_again():
    waiting = CellQueue(cells(seeds=1))
    cell = waiting.take(None)
    waiting.put_back(cell)
    assert waiting.take(cell.traffic) == cell


def test_where_no_cell_waits_none_can_be_taken():
    with pytest.raises(ValueError, match="empty"):
        CellQueue([]).take(None)
