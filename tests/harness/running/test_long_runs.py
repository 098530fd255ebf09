"""A long run is kept stretch by stretch: same rows, same scores, and never all of it in memory."""

import json
import signal
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest

from harness.common.errors import RunError, RunInterruptedError
from harness.report.page import write_run_page
from harness.running import evaluate
from harness.running.finished import read_recorded_run
from harness.running.recorder import ColumnRecorder
from harness.running.resolve import resolve_run_config
from harness.running.run import Drawing, run
from harness.storage import run_folder as runfolder
from harness.storage import tables as stored
from harness.storage.tables import GrowingTables, sampled_rows, write_table
from mmpf.tracks import Tracks
from tests.harness.full_disk import disk_full_from, moments
from tests.harness.stand_ins import SteadyTraffic, observing

ECHO = "tests.harness.stand_ins:echo_tracker"
TABLES = (runfolder.TRUTH, runfolder.DETECTIONS, runfolder.TRACKS, runfolder.ERRORS, runfolder.EVENTS)
DECIDED = (runfolder.BRAKINGS, runfolder.COMMANDS)
STEPS, EGO_STAY = 18, 6


def run_on(out: Path, *, fail_at: int | None = None, draw: Drawing | None = None) -> Path:
    traffic = SteadyTraffic(steps=STEPS, ego_stay=EGO_STAY, fail_at=fail_at)
    return run(
        resolve_run_config(options={"tracker": ECHO}), out=out, open_snapshots=observing(traffic), draw=draw
    ).folder


@pytest.fixture
def short_stretches(monkeypatch) -> None:
    """Let every episode be a stretch of its own."""
    monkeypatch.setattr(evaluate, "STRETCH_ROWS", 1)


def groups(path: Path) -> int:
    return int(pq.read_metadata(path).num_row_groups)


@pytest.mark.slow
def test_every_stretch_is_a_row_group_and_rows_and_scores_are_those_of_one_stretch(tmp_path, monkeypatch):
    whole = run_on(tmp_path / "whole")
    monkeypatch.setattr(evaluate, "STRETCH_ROWS", 1)
    parts = run_on(tmp_path / "parts")
    assert groups(whole / runfolder.TRUTH) == 1
    assert groups(parts / runfolder.TRUTH) == STEPS // EGO_STAY
    for name in (*TABLES, *DECIDED):
        pd.testing.assert_frame_equal(pd.read_parquet(parts / name), pd.read_parquet(whole / name))
    scores = [json.loads((folder / runfolder.METRICS).read_text()) for folder in (whole, parts)]
    for key in ("mot", "mot_all", "gospa", "coverage", "traffic"):
        assert scores[1][key] == pytest.approx(scores[0][key], rel=1e-12), key


def test_a_run_that_fails_keeps_the_steps_of_all_stretches_and_no_scores(tmp_path, short_stretches):
    with pytest.raises(RunError, match="after 15 steps"):
        run_on(tmp_path / "run", fail_at=15)
    folder = tmp_path / "run.incomplete"
    assert json.loads((folder / runfolder.MANIFEST).read_text())["status"] == runfolder.FAILED
    for name in TABLES[:3]:
        assert sorted(pd.read_parquet(folder / name)["step"].unique()) == list(range(15)), name
    assert not [name for name in (runfolder.ERRORS, runfolder.EVENTS, runfolder.METRICS) if (folder / name).exists()]


def test_an_error_between_two_tables_writes_no_row_twice(tmp_path):
    table = pd.DataFrame({"step": [0, 1], "state": ["a", "b"]})
    tables = GrowingTables(tmp_path)
    tables.append(0, {"one.parquet": table})
    tables.append(0, {"one.parquet": table, "two.parquet": table})
    tables.append(1, {"one.parquet": table.assign(step=[2, 3]), "two.parquet": table.assign(step=[2, 3])})
    tables.close()
    for name in ("one.parquet", "two.parquet"):
        assert pd.read_parquet(tmp_path / name)["step"].tolist() == [0, 1, 2, 3]


@pytest.mark.slow
def test_ctrl_c_while_stretches_are_put_together_leaves_every_row_once(tmp_path, short_stretches, monkeypatch):
    # Shells start background jobs with Ctrl-C ignored, which the tests inherit.
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    put_together = stored._put_together

    def interrupted(parts: Sequence[Path], final: Path) -> None:
        put_together(parts, final)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(stored, "_put_together", interrupted)
    with pytest.raises(RunInterruptedError, match=f"after {STEPS} steps"):
        run_on(tmp_path / "run")
    signal.signal(signal.SIGINT, previous)
    folder = tmp_path / "run.incomplete"
    truth = pd.read_parquet(folder / runfolder.TRUTH)
    assert truth["step"].nunique() == STEPS
    assert not truth.duplicated(["step", "vehicle_id"]).any()


def test_a_table_of_one_stretch_has_the_bytes_of_a_table_that_is_written_at_once(tmp_path):
    table = pd.DataFrame({"step": range(1000), "x": [0.1 * k for k in range(1000)], "name": ["a", ""] * 500})
    write_table(table, tmp_path / "at_once.parquet")
    tables = GrowingTables(tmp_path)
    tables.append(0, {"grown.parquet": table})
    tables.close()
    assert (tmp_path / "grown.parquet").read_bytes() == (tmp_path / "at_once.parquet").read_bytes()


WRITES = 38
"""How many files a run of three stretches writes, its ledger first and last."""


def kept_steps(folder: Path, table: str) -> list[int]:
    """Return the steps of a table that a full disk may have left in several files, each as often as it is there."""
    stem = Path(table).stem
    files = [folder / table, *folder.glob(f"{stem}-[0-9].parquet")]
    return sorted(step for file in files for step in pd.read_parquet(file)["step"].unique())


@pytest.mark.parametrize("write", moments(WRITES, often=12))
def test_whenever_a_disk_fills_for_good_every_stretch_that_was_written_is_kept_once(write, tmp_path, short_stretches):
    with disk_full_from(write) as written, pytest.raises(RunError, match="No space left on device"):
        run_on(tmp_path / "run")
    # A stretch is there when the last of its tables is.
    stretches = len({name for name in written if name.startswith("tracks")})
    folder = tmp_path / "run.incomplete"
    assert list(tmp_path.iterdir()) == ([folder] if stretches else [])
    for name in TABLES[:3] if stretches else ():
        assert kept_steps(folder, name) == list(range(stretches * EGO_STAY)), name
    assert not [path for path in folder.glob("*") if path.name in (*TABLES[3:], *DECIDED, runfolder.METRICS)]


@pytest.mark.slow
def test_a_run_writes_as_often_as_the_moments_above_suppose(tmp_path, short_stretches):
    with disk_full_from(WRITES + 1) as written:
        run_on(tmp_path / "run")
    assert len(written) == WRITES


def test_a_column_of_whole_numbers_in_one_stretch_and_of_others_in_the_next_keeps_its_values(tmp_path):
    tables = GrowingTables(tmp_path)
    for stretch, values in enumerate(([1, 2], [2.5, float("nan")])):
        tables.append(stretch, {"t.parquet": pd.DataFrame({"step": [stretch, stretch], "x": values})})
    tables.append(2, {"t.parquet": pd.DataFrame({"step": [2], "x": [3], "y": [4.0]})})
    tables.close()
    table = pd.read_parquet(tmp_path / "t.parquet")
    assert table["step"].tolist() == [0, 0, 1, 1, 2]
    assert table["x"].tolist() == pytest.approx([1.0, 2.0, 2.5, float("nan"), 3.0], nan_ok=True)
    assert table["y"].isna().tolist() == [True] * 4 + [False]


def test_the_recorder_never_ends_a_stretch_within_an_episode():
    recorder = ColumnRecorder(stretch_rows=1)
    ended: list[list[int]] = []

    def end() -> None:
        ended.append(sorted(recorder.tables()["truth.parquet"]["step"].unique()))
        recorder.forget()

    recorder.end_stretch = end
    for snapshot in observing(SteadyTraffic(steps=7, ego_stay=3))(resolve_run_config(options={"tracker": ECHO})):
        recorder.add(snapshot, Tracks.none())
    assert ended == [[0, 1, 2], [3, 4, 5]]
    assert recorder.tables()["truth.parquet"]["step"].unique().tolist() == [6]
    assert recorder.steps == 7


@pytest.mark.slow
def test_the_page_of_a_long_run_shows_its_beginning_and_says_so(tmp_path, short_stretches, monkeypatch):
    monkeypatch.setattr("harness.report.page.MOST_SHOWN", 300)
    draw = Drawing(lambda folder, pictured: folder.mkdir(), write_run_page)
    folder = run_on(tmp_path / "run", draw=draw)
    assert "replay and failures of its first 1 s" in (folder / "report.html").read_text()
    beginning = read_recorded_run(folder, most_rows=300)
    assert not beginning.whole
    for table in (beginning.truth, beginning.detections, beginning.tracks, beginning.errors):
        assert table["step"].max() == 2 * EGO_STAY - 1
    assert read_recorded_run(folder, most_rows=10_000).whole


def test_figures_of_a_long_run_show_whole_steps_evenly(tmp_path):
    table = pd.DataFrame({"step": [step for step in range(100) for _ in range(3)], "x": range(300)})
    tables = GrowingTables(tmp_path)
    for stretch, rows in enumerate((table[:150], table[150:])):
        tables.append(stretch, {"t.parquet": rows})
    tables.close()
    pd.testing.assert_frame_equal(sampled_rows(tmp_path / "t.parquet", 400), table)
    sample = sampled_rows(tmp_path / "t.parquet", 100)
    assert sample["step"].tolist() == [step for step in range(0, 100, 4) for _ in range(3)]
