"""What is asked of a cluster and made of its answers; the cluster is one of this process."""

import sys
from types import SimpleNamespace

import pytest

from harness.common.errors import InputError, RunError
from harness.grid.cluster import CONNECT_S, connect, run_cell, run_cells_on_cluster
from harness.grid.grid import GridRequest, plan_grid

CELLS = plan_grid(GridRequest(densities="20", seeds="3", trackers="mmpf,pmbm", duration_s=1.0)).cells


class Task:
    """A task of a cluster; ``error`` is what became of it."""

    def __init__(self, cell, error: Exception | str | None) -> None:
        self.cell, self.error, self.released, self.limits = cell, error, 0, []
        self.status = "finished" if error in (None, "late") else error if isinstance(error, str) else "error"

    def exception(self, timeout: float) -> Exception | None:
        self.limits.append(timeout)
        return None if isinstance(self.error, str) else self.error

    def result(self, timeout: float) -> list:
        self.limits.append(timeout)
        if self.error == "late" and len(self.limits) < 5:
            raise TimeoutError
        return [(run.key, {"seed": run.config.seed}) for run in self.cell.runs]

    def release(self) -> None:
        self.released += 1

    def done(self) -> bool:
        return self.released > 0


class Cluster:
    """A cluster that ends its tasks backwards."""

    loop, status = "the loop", "running"

    def __init__(self, *errors: Exception | str | None) -> None:
        self.errors, self.asked, self.tasks, self.cancelled = list(errors), [], [], None

    def submit(self, work, cell, timeout_s, **options) -> Task:
        self.asked.append((work, cell, timeout_s, options))
        self.tasks.append(Task(cell, self.errors.pop(0)))
        return self.tasks[-1]

    def cancel(self, tasks) -> None:
        self.cancelled = tasks
        raise OSError("gone")


@pytest.fixture(autouse=True)
def distributed(monkeypatch):
    made = SimpleNamespace(as_completed=lambda tasks, loop: reversed(tasks) if loop == "the loop" else ())
    monkeypatch.setitem(sys.modules, "distributed", made)
    return made


def test_each_cell_is_a_task_whose_rows_are_told_once():
    client, rows = Cluster(None, None, None), {}
    run_cells_on_cluster(client, CELLS, 30.0, rows.__setitem__)
    assert client.asked == [(run_cell, cell, 30.0, {"pure": False, "retries": 3}) for cell in CELLS]
    assert list(rows) == [run.key for cell in reversed(CELLS) for run in cell.runs]
    assert [row["seed"] for row in rows.values()] == [2, 2, 1, 1, 0, 0]
    assert [(task.released, task.limits) for task in client.tasks] == [(1, [CONNECT_S, CONNECT_S])] * 3
    assert client.cancelled == []


def test_a_cell_that_the_cluster_gives_up_is_failed_rows_with_its_reason():
    client, rows = Cluster(None, ValueError("no\nway"), None), {}
    run_cells_on_cluster(client, CELLS, None, rows.__setitem__)
    failed = [row for row in rows.values() if row.get("succeeded") is False]
    assert [row["seed"] for row in failed] == [1, 1]
    assert {row["error"] for row in failed} == {"the cluster gave the task up: ValueError: no way"}
    assert {row["total_s"] for row in failed} == {0.0}


def test_rows_that_another_worker_makes_again_are_awaited_as_long_as_the_scheduler_answers():
    client, rows = Cluster(None, "late", None), {}
    run_cells_on_cluster(client, CELLS, None, rows.__setitem__)
    assert [row["seed"] for row in rows.values()] == [2, 2, 1, 1, 0, 0]
    client = Cluster(None, "late", None)
    client.status = "connecting"
    with pytest.raises(RunError, match="scheduler was lost"):
        run_cells_on_cluster(client, CELLS, None, rows.__setitem__)


def test_without_dask_it_is_told_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError) as caught:
        connect("tcp://h:1")
    assert str(caught.value) == "`scheduler` needs Dask: pip install -c constraints.txt '.[cluster]'"
