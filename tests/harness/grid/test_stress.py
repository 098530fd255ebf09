"""Whole grids on stand-in traffic in this process, and a few on SUMO in real workers."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from harness.commands.app import run_command_line
from harness.common.errors import InputError, RunError, RunInterruptedError
from harness.grid.grid import GridRequest
from harness.grid.stress import FinishedGrid, run_stress
from harness.grid.worker import Finished, work_on_cell
from harness.running.open import OpenLooks
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.storage.grid_rows import flattened
from tests.harness.full_disk import disk_full_from, moments
from tests.harness.stand_ins import SteadyTraffic, looking_at

REPOSITORY = Path(__file__).parents[3]
ECHO = "tests.harness.stand_ins:echo_tracker"
BROKEN = "tests.harness.grid.broken_trackers"
STEADY = looking_at(SteadyTraffic(steps=8))
SMALL = GridRequest(densities="20,40", seeds="2", trackers=f"{ECHO},{ECHO}+gain=2", duration_s=1.0)


class InProcess:
    """Runs cells here, one after the other, by default on stand-in traffic; stops as Ctrl-C does after some rows."""

    def __init__(self, stop_after: int | None = None, open_looks: OpenLooks = STEADY) -> None:
        self.stop_after, self.open_looks, self.rows, self.cells = stop_after, open_looks, 0, 0

    def __call__(self, cells, on_row) -> None:
        def report(message) -> None:
            if isinstance(message, Finished):
                if self.rows == self.stop_after:
                    raise KeyboardInterrupt
                self.rows += 1
                on_row(message.key, message.row)

        for cell in cells:
            self.cells += 1
            work_on_cell(cell, report, self.open_looks)


@pytest.fixture(autouse=True, scope="module")
def _no_figures():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.analysis.tables.curves_figure", lambda *arguments: _NoFigure())
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """Return the folder of a finished small grid, which no test may change."""
    return grid(tmp_path_factory.mktemp("finished") / "grid").folder


@pytest.fixture
def finished(whole, tmp_path) -> Path:
    """Return a copy of it that is the test's own."""
    return shutil.copytree(whole, tmp_path / "grid")


class _NoFigure:
    def savefig(self, path: Path, **options: object) -> None:
        path.touch()


def grid(out: Path, request: GridRequest = SMALL, execute=None, **options) -> FinishedGrid:
    return run_stress(request, out, execute or InProcess(), **options)


def is_timing(column: str) -> bool:
    """Whether a column holds wall time, which differs between runs of the same configuration."""
    return column == "total_s" or (column.startswith("timing.") and column != "timing.steps")


def table_of(folder: Path) -> pd.DataFrame:
    table = pd.read_parquet(folder / "runs.parquet")
    return table[[column for column in table if not is_timing(column)]]


def test_a_grid_leaves_one_row_for_each_run_in_a_fixed_order(whole):
    table = table_of(whole)
    assert table[["density", "seed", "variant"]].to_numpy().tolist() == [
        [density, seed, variant] for density in (20, 40) for seed in (0, 1) for variant in (ECHO, f"{ECHO}+gain=2")
    ]
    assert table["succeeded"].all()
    assert table["mae.visible.lon_m"].gt(0.0).all()
    assert (whole / "summary.json").is_file()
    assert (whole / "table.md").is_file()


def test_traffic_is_made_once_for_all_trackers_of_a_density_and_seed(tmp_path):
    opened = []

    def open_looks(config):
        opened.append((config.traffic.density, config.seed))
        return STEADY(config)

    grid(tmp_path / "grid", execute=InProcess(open_looks=open_looks))
    assert sorted(opened) == [(20.0, 0), (20.0, 1), (40.0, 0), (40.0, 1)]


def test_an_interrupted_grid_taken_up_again_equals_an_uninterrupted_one(whole, tmp_path):
    for stop in (0, 3, 7):
        folder = tmp_path / f"stopped-{stop}"
        with pytest.raises(RunInterruptedError, match=f"{stop} of 8 runs.*`resume`"):
            grid(folder, execute=InProcess(stop_after=stop))
        rest = InProcess()
        pd.testing.assert_frame_equal(table_of(grid(folder, execute=rest, resume=True).folder), table_of(whole))
        assert rest.rows == 8 - stop


def test_a_finished_grid_is_not_run_again(finished):
    again = InProcess()
    grid(finished, execute=again, resume=True)
    assert again.cells == 0


def test_a_resumed_grid_may_have_more_seeds(finished):
    more = InProcess()
    larger = GridRequest(**{**SMALL.__dict__, "seeds": "3"})
    assert len(table_of(grid(finished, larger, more, resume=True).folder)) == 12
    assert more.rows == 4


def test_an_existing_folder_is_never_overwritten_without_asking(whole, tmp_path):
    with pytest.raises(InputError, match="`resume`"):
        grid(whole)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    with pytest.raises(InputError, match="not a stress test's folder"):
        grid(tmp_path / "mine", resume=True)


def test_half_written_files_of_a_killed_grid_are_removed(finished):
    (finished / "kept" / "a run" / "figures").mkdir(parents=True)
    (finished / "notes").mkdir()
    for folder in (".", "runs", "figures", "kept", "kept/a run", "kept/a run/figures", "notes"):
        (finished / folder / ".left.json.123.partial").write_text("{")
    grid(finished, resume=True)
    assert [path.parent.name for path in finished.rglob("*.partial")] == ["notes"]


def test_a_failing_tracker_is_a_row_and_the_others_run_on(tmp_path):
    request = GridRequest(densities="20", seeds="2", trackers=f"{BROKEN}:raising,{ECHO}", duration_s=1.0)
    finished = grid(tmp_path / "grid", request)
    table = table_of(finished.folder)
    assert table["succeeded"].tolist() == [False, True, False, True]
    assert table["error"].tolist()[0] == "ArithmeticError: the weights all vanished"
    assert table["error"].isna().tolist() == [False, True, False, True]
    assert len(finished.failures) == 2
    assert "ArithmeticError" in (finished.folder / "table.md").read_text()


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b"\xff\xfe", b'{"succeeded": 1}', b'{"succeeded": false}'])
def test_a_damaged_row_is_made_again(whole, finished, damage):
    rows = sorted((finished / "runs").glob("*.json"))
    rows[3].write_bytes(damage)
    again = InProcess()
    pd.testing.assert_frame_equal(table_of(grid(finished, execute=again, resume=True).folder), table_of(whole))
    assert again.rows == 1


def test_a_row_in_whose_place_there_is_a_pipe_is_told(finished):
    row = sorted((finished / "runs").glob("*.json"))[3]
    row.unlink()
    os.mkfifo(row)
    with pytest.raises(InputError, match=r"`out`.*is no file of a stress test"):
        grid(finished, resume=True)


def test_finished_runs_of_another_grid_never_drop_out_of_the_tables(whole, finished):
    fewer = GridRequest(**{**SMALL.__dict__, "seeds": "1"})
    with pytest.raises(InputError, match="holds 4 runs of another grid"):
        grid(finished, fewer, resume=True)
    pd.testing.assert_frame_equal(table_of(finished), table_of(whole))
    for row in (finished / "runs").glob("*.json"):
        row.unlink()
    with pytest.raises(InputError, match="have no files"):
        grid(finished, resume=True)
    pd.testing.assert_frame_equal(table_of(finished), table_of(whole))


def test_a_second_process_on_the_same_grid_is_refused(tmp_path):
    def meanwhile(cells, on_row) -> None:
        with pytest.raises(InputError, match="another process is writing"):
            grid(tmp_path / "grid", resume=True)
        InProcess()(cells, on_row)

    grid(tmp_path / "grid", execute=meanwhile)
    assert len(table_of(tmp_path / "grid")) == 8
    assert not list((tmp_path / "grid").rglob("*lock"))


GRID_WRITES = 16
"""How many files a grid of eight runs writes: ledger, manifest, request, rows, tables and figure, manifest again."""


@pytest.mark.parametrize("write", moments(GRID_WRITES))
def test_whenever_a_disk_fills_a_grid_ends_in_one_line_and_is_taken_up_as_if_it_had_not(write, whole, tmp_path):
    with (
        disk_full_from(write) as written,
        pytest.raises(RunError, match=r"can't go on \(.*No space left on device\); \d of 8 runs are kept.*`resume`"),
    ):
        grid(tmp_path / "grid")
    rows = {path.stem for path in (tmp_path / "grid" / "runs").iterdir()}
    assert rows == {name.removesuffix(".json") for name in written if (tmp_path / "grid" / "runs" / name).is_file()}
    rest = InProcess()
    pd.testing.assert_frame_equal(table_of(grid(tmp_path / "grid", execute=rest, resume=True).folder), table_of(whole))
    assert rest.rows == 8 - len(rows)


def test_a_grid_writes_as_often_as_the_moments_above_suppose(tmp_path):
    with disk_full_from(GRID_WRITES + 1) as written:
        grid(tmp_path / "grid")
    assert len(written) == GRID_WRITES


def test_nothing_of_a_strangers_folder_is_touched(tmp_path):
    mine = tmp_path / "mine"
    (mine / "runs").mkdir(parents=True)
    for name in ("manifest.json", "runs.parquet", "summary.json", "table.md", "runs/x.partial", "runs/y.json"):
        (mine / name).write_text('{"name": "web"}')
    before = {path: path.read_bytes() for path in mine.rglob("*") if path.is_file()}
    with pytest.raises(InputError, match="not a stress test's folder"):
        grid(mine, resume=True)
    assert {path: path.read_bytes() for path in mine.rglob("*") if path.is_file()} == before


def test_failed_runs_are_kept_unless_asked_to_be_made_again(tmp_path):
    request = GridRequest(densities="20", seeds="2", trackers=f"{BROKEN}:raising,{ECHO}", duration_s=1.0)
    grid(tmp_path / "grid", request)
    kept, made_again = InProcess(), InProcess()
    grid(tmp_path / "grid", request, kept, resume=True)
    assert kept.rows == 0
    grid(tmp_path / "grid", request, made_again, resume=True, retry_failed=True)
    assert made_again.rows == 2


def test_failing_traffic_fails_every_run_of_its_cell(tmp_path):
    def open_looks(config):
        return (looking_at(SteadyTraffic(steps=8, fail_at=5)) if config.seed == 1 else STEADY)(config)

    table = table_of(grid(tmp_path / "grid", execute=InProcess(open_looks=open_looks)).folder)
    assert table["succeeded"].tolist() == [True, True, False, False] * 2
    assert table.loc[~table["succeeded"], "error"].unique().tolist() == ["RuntimeError: the traffic broke"]


def test_a_row_holds_what_a_single_run_writes(tmp_path):
    request = GridRequest(densities="20", seeds="3:4", trackers=ECHO, duration_s=1.0)
    row = table_of(grid(tmp_path / "grid", request).folder).iloc[0]
    config = resolve_run_config(options={"density": 20.0, "seed": 3, "tracker": ECHO, "duration": 1.0})
    metrics = run(config, out=tmp_path / "run", open_looks=STEADY).metrics
    single = flattened({name: value for name, value in metrics.items() if name != "run"})
    compared = [name for name in single if not is_timing(name)]
    assert len(compared) > 100
    for name in compared:
        assert row[name] == single[name] or (single[name] is None and pd.isna(row[name])), name


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--vary", "sensor.rnge_m=40:160:20"], "--vary: sensor.rnge_m: no such setting"),
        (["--vary", "sensor.range_m=-5:5:5"], "--vary: sensor.range_m"),
        (["--densities", "65:5:10"], "--densities 65:5:10"),
        (["--trackers", "mmpf,nonsense"], "--trackers nonsense: unknown; choose one of"),
        (["--models", "nonsense"], "unknown motion model 'nonsense'; known are"),
        (["--net", "nonsense"], "--net nonsense: no such network"),
        (["--demands", "nonsense"], "no such demand"),
        (["--scheduler", "tcp://host:1", "--workers", "2"], "--workers"),
    ],
)
def test_a_wrong_grid_ends_with_two_before_anything_is_written(arguments, complaint, tmp_path, capsys):
    assert run_command_line(["stress", "--out", str(tmp_path / "grid"), *arguments]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert complaint in lines[0]
    assert not (tmp_path / "grid").exists()


def command(out: Path, *arguments: str) -> list[str]:
    return [
        sys.executable, "-m", "harness", "stress", "--out", str(out), "--duration", "1", "--quiet", *arguments,
    ]  # fmt: skip


@pytest.mark.slow
def test_runs_that_raise_hang_or_kill_their_worker_are_three_rows_with_their_reason(tmp_path):
    trackers = ",".join([*(f"{BROKEN}:{name}" for name in ("raising", "hanging", "dying")), ECHO])
    outcome = subprocess.run(
        command(tmp_path / "grid", "--densities", "20", "--seeds", "1", "--trackers", trackers, "--timeout-per-run",
                "15", "--workers", "2"),
        cwd=REPOSITORY, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert outcome.returncode == 3, outcome.stderr
    table = table_of(tmp_path / "grid")
    assert table["succeeded"].tolist() == [False, False, False, True]
    raised, hung, died = table["error"].iloc[:3]
    assert raised == "ArithmeticError: the weights all vanished"
    assert hung == "timeout: the run took longer than 15 s"
    assert "died (signal SIGKILL" in died
    assert len(outcome.stderr.strip().splitlines()) == 1
