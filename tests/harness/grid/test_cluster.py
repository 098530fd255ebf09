"""A real scheduler and two real workers on loopback, one of which is killed."""

import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pytest

from harness.common.errors import InputError
from harness.grid.cluster import connect
from harness.grid.grid import GridRequest
from harness.grid.stress import run_stress
from harness.running.open import open_snapshots
from tests.harness.grid.executors import InProcess, table_of

REPOSITORY = Path(__file__).parents[3]
GRID = ("--densities", "10,15", "--seeds", "2", "--models", "cvm", "--particles", "20", "--duration", "1", "--quiet")


def test_a_scheduler_that_does_not_answer_is_told_in_one_line(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("harness.grid.cluster.CONNECT_S", 0.2)
    with pytest.raises(InputError, match=r"^`scheduler` tcp://127.0.0.1:9: .*for example `scheduler` tcp://host:8786$"):
        connect("tcp://127.0.0.1:9")


def stress(out: Path, *arguments: str, **options: object) -> subprocess.Popen:
    command = [sys.executable, "-m", "harness", "stress", "--out", str(out), *GRID, *arguments]
    return subprocess.Popen(command, cwd=REPOSITORY, **options)


@contextmanager
def dask_cluster(tmp_path):
    """Yield the scheduler's address, and its process with those of the workers."""
    pytest.importorskip("distributed")
    file = tmp_path / "scheduler.json"
    shared = {"cwd": REPOSITORY, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    processes = [subprocess.Popen([*command, "--no-dashboard", "--scheduler-file", str(file)], **shared)]
    for number in range(2):
        command = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file)]
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(tmp_path / str(number))]
        processes.append(subprocess.Popen([*command, *options], **shared))
    try:
        yield _address(file), processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _address(file: Path) -> str:
    from distributed import Client  # noqa: PLC0415

    _wait_until(file.exists)
    with Client(scheduler_file=str(file), set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
        return client.scheduler.address


def _wait_until(condition, limit_s: float = 120.0) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.05)


@pytest.mark.slow
def test_a_grid_that_loses_a_worker_has_the_rows_of_one_machine_and_one_that_loses_its_scheduler_goes_on_here(
    tmp_path, no_pictures
):
    local, remote, out = (tmp_path / name for name in ("local", "remote", "out"))

    def begun(folder, **options):
        running = stress(folder, "--scheduler", address, **options)
        _wait_until(lambda: any(folder.glob("runs/*.json")) or running.poll() is not None)
        assert running.poll() is None
        return running

    with dask_cluster(tmp_path) as (address, (scheduler, worker, _)):
        running = begun(remote)
        worker.kill()
        assert running.wait(timeout=300) == 0
        running = begun(out, stderr=subprocess.PIPE, text=True)
        scheduler.kill()
        _, err = running.communicate(timeout=60)
    assert running.returncode == 3, err
    assert len(err.splitlines()) == 1, err
    assert "scheduler was lost" in err
    kept = {path: path.read_bytes() for path in out.glob("runs/*.json")}
    assert kept
    request = GridRequest(densities="10,15", seeds="2", models="cvm", particles=20, duration_s=1.0)
    run_stress(request, out, InProcess(open_snapshots), resume=True)
    assert {path: path.read_bytes() for path in kept} == kept
    run_stress(request, local, InProcess(open_snapshots))
    assert len(table_of(local)) == 4
    for folder in (remote, out):
        pd.testing.assert_frame_equal(table_of(folder), table_of(local), check_exact=True)
