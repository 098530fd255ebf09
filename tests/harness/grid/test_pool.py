"""Which cell each worker process is given next."""

import pytest

from harness.grid.grid import GridRequest, plan_grid
from harness.grid.pool import CellQueue


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
