"""Whole grids on stand-in traffic in this process, and a few on SUMO in real workers."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from harness.grid.grid import GridRequest
from harness.grid.stress import FinishedGrid, run_stress
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.storage.grid_folder import flattened
from tests.harness.grid.executors import BROKEN, ECHO, STEADY, InProcess, is_timing, table_of
from tests.harness.stand_ins import SteadyTraffic, observing

pytestmark = pytest.mark.usefixtures("no_pictures")

REPOSITORY = Path(__file__).parents[3]


def grid(out: Path, request: GridRequest, execute=None) -> FinishedGrid:
    return run_stress(request, out, execute or InProcess())


def test_runs_stand_in_a_fixed_order_and_what_fails_is_a_row_beside_those_that_run_on(tmp_path):
    opened = []

    def open_snapshots(config):
        opened.append((config.traffic.density, config.seed))
        return (observing(SteadyTraffic(steps=8, fail_at=5)) if config.seed == 1 else STEADY)(config)

    request = GridRequest(densities="20,40", seeds="2", trackers=f"{BROKEN}:raising,{ECHO}", duration_s=1.0)
    finished = grid(tmp_path / "grid", request, InProcess(open_snapshots))
    assert sorted(opened) == [(20.0, 0), (20.0, 1), (40.0, 0), (40.0, 1)]  # once for all trackers
    table = table_of(finished.folder)
    assert table[["density", "seed", "variant"]].to_numpy().tolist() == [
        [density, seed, variant] for density in (20, 40) for seed in (0, 1) for variant in (f"{BROKEN}:raising", ECHO)
    ]
    weights, traffic = "ArithmeticError: the weights all vanished", "RuntimeError: the traffic broke"
    errors = table["error"].fillna("").tolist()
    assert [weights in errors[0], weights in errors[4]] == [True, True]
    assert errors[1:4] == errors[5:] == ["", traffic, traffic]
    assert table["succeeded"].tolist() == [False, True, False, False] * 2
    assert table.loc[table["succeeded"], "mae.visible.lon_m"].gt(0.0).all()
    assert len(finished.failures) == 6
    assert weights in (finished.folder / "table.md").read_text()


def test_a_row_holds_what_a_single_run_writes(tmp_path):
    request = GridRequest(densities="20", seeds="3:4", trackers=ECHO, duration_s=1.0)
    row = table_of(grid(tmp_path / "grid", request).folder).iloc[0]
    config = resolve_run_config(options={"density": 20.0, "seed": 3, "tracker": ECHO, "duration": 1.0})
    metrics = run(config, out=tmp_path / "run", open_snapshots=STEADY).metrics
    single = flattened({name: value for name, value in metrics.items() if name != "run"})
    compared = [name for name in single if not is_timing(name)]
    assert len(compared) > 100
    for name in compared:
        assert row[name] == single[name] or (single[name] is None and pd.isna(row[name])), name


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--vary", "sensor.rnge_m=40:160:20"], "--vary: sensor.rnge_m: no such setting"),
        (["--trackers", "mmpf,nonsense"], "--trackers nonsense: unknown; choose one of"),
        (["--keep", "everything"], "only runs can be kept"),
        (["--nets", "curve,curve"], "--nets"),
        (["--nets", "curve,nowhere"], "nowhere"),
        (["--nets", "curve,us101", "--demands", "light"], "us101 has no such demand"),
    ],
)
def test_a_wrong_grid_ends_with_two_before_anything_is_written(arguments, complaint, tmp_path, refused):
    assert complaint in refused("stress", "--out", "grid", *arguments)
    assert not list(tmp_path.iterdir())


def command(out: Path, *arguments: str) -> list[str]:
    return [
        sys.executable, "-m", "harness", "stress", "--out", str(out), "--duration", "1", "--quiet", *arguments,
    ]  # fmt: skip


@pytest.mark.slow
def test_runs_that_raise_hang_or_kill_their_worker_are_three_rows_with_their_reason(tmp_path):
    trackers = ",".join([*(f"{BROKEN}:{name}" for name in ("raising", "hanging", "dying")), ECHO])
    outcome = subprocess.run(
        command(tmp_path / "grid", "--densities", "5", "--seeds", "1", "--trackers", trackers, "--timeout-per-run",
                "8", "--workers", "2"),
        cwd=REPOSITORY, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert outcome.returncode == 3, outcome.stderr
    table = table_of(tmp_path / "grid")
    assert table["succeeded"].tolist() == [False, False, False, True]
    raised, hung, died = table["error"].iloc[:3]
    assert "ArithmeticError: the weights all vanished" in raised
    assert hung == "timeout: the run took longer than 8 s"
    assert "died (signal SIGKILL" in died
    assert len(outcome.stderr.strip().splitlines()) == 1
