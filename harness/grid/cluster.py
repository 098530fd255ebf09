"""Runs cells on an existing Dask cluster; the rows are the same as on this machine."""

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any

from harness.common.errors import InputError, RunError
from harness.grid.cells import Cell, failed_row
from harness.grid.pool import OnRow, run_cells
from harness.storage.grid_folder import Row

# Dask has no types of its own.
Client = Any
Future = Any

PARAMETER = "scheduler"
EXAMPLE = "tcp://host:8786"
CONNECT_S = 10
RETRIES = 3
CANCELLED, FINISHED, CONNECTED = "cancelled", "finished", "running"
LOST = "the connection to the cluster's scheduler was lost"
MEND = "the rows that had arrived are kept: start the scheduler again, then the same command with `resume`"


def connect(address: str) -> Client:
    """Return a connection to a cluster's scheduler."""
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise InputError(f"`{PARAMETER}` needs Dask: pip install -c constraints.txt '.[cluster]'") from None
    # Its log repeats with tracebacks what is told in one line here.
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        return distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"`{PARAMETER}` {address}: no scheduler answers ({problem}); for example `{PARAMETER}` {EXAMPLE}"
        ) from None


def run_cells_on_cluster(client: Client, cells: Sequence[Cell], timeout_s: float | None, on_row: OnRow) -> None:
    """Run all cells on the cluster's workers, a cell a task; ``harness.grid.pool.run_cells`` tells of the arguments.

    A cell whose worker disappears is given to another one; its runs are made again.
    """
    distributed: Any = import_module("distributed")
    tasks: dict[Future, Cell] = {
        client.submit(run_cell, cell, timeout_s, pure=False, retries=RETRIES): cell for cell in cells
    }
    try:
        for task in distributed.as_completed(list(tasks), loop=client.loop):
            for key, row in _rows_of(client, task, tasks[task]):
                on_row(key, row)
            task.release()
    finally:
        # Of a scheduler that is gone there is nothing to take back.
        with suppress(Exception):
            client.cancel([task for task in tasks if not task.done()])


def run_cell(cell: Cell, timeout_s: float | None) -> list[tuple[str, Row]]:
    """Run one cell in a process of its own, on the machine that this is called on."""
    rows: list[tuple[str, Row]] = []
    run_cells([cell], 1, timeout_s, lambda key, row: rows.append((key, row)))
    return rows


def _rows_of(client: Client, task: Future, cell: Cell) -> list[tuple[str, Row]]:
    try:
        error = None if task.status == CANCELLED else _told(client, task.exception)
        rows: list[tuple[str, Row]] | None = _told(client, task.result) if task.status == FINISHED else None
    # Dask has many words for it: cancelled, closed, timed out.
    except Exception as lost:
        raise RunError(f"{LOST} ({type(lost).__name__}); {MEND}") from None
    if rows is not None:
        return rows
    if error is None:
        raise RunError(f"{LOST}; {MEND}")
    reason = f"the cluster gave the task up: {type(error).__name__}: {error}"
    return [(run.key, failed_row(run, reason, 0.0)) for run in cell.runs]


def _told(client: Client, ask: Callable[..., Any]) -> Any:  # noqa: ANN401  Dask's
    """Return what a task tells; if its worker died with its rows, another worker has to make them again first."""
    while True:
        try:
            return ask(timeout=CONNECT_S)
        except TimeoutError:
            if client.status != CONNECTED:
                raise
