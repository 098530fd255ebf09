"""Whole closed loops: the same beginning for every belief and the same bytes again."""

import errno
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.closedloop import episode, worker
from harness.closedloop.episode_start import EpisodeStart
from harness.closedloop.plan import BRAKE, CROSS, DARK, FREE, STOPPED, DriveRequest, plan_drives
from harness.commands.actions.make_drives import make_drives
from harness.common import files
from harness.common.errors import InputError, RunError
from harness.decisions.drivers.protocol import Command
from harness.grid.worker import Finished
from harness.running.evaluate import evaluation_of
from harness.scoring.metrics.closedloop import COLLIDED
from harness.storage import run_folder as runfolder
from harness.storage.run_folder import read_table
from mmpf.registry import UnknownNameError
from tests.harness.grid.executors import InProcess

LAST_TRACKED = 50
SMALL = {"density": 15.0, "perception": "truth,detections", "episodes": 2, "seed": 100, "workers": 1}


class Reckless:
    """Accelerates whatever is ahead."""

    def command(self, belief):
        never = np.zeros(len(belief), dtype=bool)
        return Command(np.full(len(belief), 1.0), never, never)


@pytest.fixture
def here(monkeypatch, no_pictures):
    """Drive in this process instead of workers, which take seconds to start, and draw nothing."""

    def in_turn(cells, workers, timeout_s, on_row, module):
        InProcess(work=worker.work_on_cell)(cells, on_row)

    monkeypatch.setattr("harness.closedloop.drive.run_cells", in_turn)


def made(out, **options):
    return make_drives({"out": out, **SMALL, **options}, "test", quiet=True).folder


def driven(traffic, at, run):
    """Drive an episode in a fork; return the tables of its row, and those that were recorded."""
    evaluations = []

    def kept(config, snapshots):
        evaluations.append(evaluation_of(config, snapshots))
        return evaluations[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(episode, "evaluation_of", kept)
        table, evaluated = episode.run_episode(traffic, at, run)
    return table, evaluations[0].recorded() if evaluated is None else evaluated.tables


@pytest.mark.slow
def test_every_belief_begins_with_the_same_traffic_and_detections_and_then_goes_its_own_way():
    cell = plan_drives(DriveRequest("truth,detections", 1, seed=100, density=30.0)).cells[0]
    tables = {}
    with worker.opened(cell) as traffic:
        at = next(worker._episodes(traffic, cell))
        for run in cell.runs:
            tables[run.variant] = worker.in_fork(lambda run=run: driven(traffic, at, run))[1]
    whole = tables["truth"][runfolder.TRUTH]
    assert whole["step"].max() > LAST_TRACKED
    for name, other in tables.items():
        for kind in (runfolder.TRUTH, runfolder.DETECTIONS):
            mine, theirs = (each[kind] for each in (tables["truth"], other))
            mine, theirs = (each[each["step"] <= LAST_TRACKED].reset_index(drop=True) for each in (mine, theirs))
            assert mine.equals(theirs), (name, kind)
        assert name == "truth" or not whole.equals(other[runfolder.TRUTH])


@pytest.mark.slow
def test_a_command_that_was_killed_and_taken_up_leaves_the_same_bytes(tmp_path, request):
    folder = made(tmp_path / "out")
    names = ("runs.parquet", "table.md", "summary.json")
    whole = {name: (folder / name).read_bytes() for name in names}
    rows = sorted((folder / "runs").iterdir())
    for path in (*rows[1:3], *(folder / name for name in names)):  # one of each episode and of each belief
        path.unlink()
    rows[0].with_name(".half.tmp").write_text("{")
    request.getfixturevalue("here")
    made(folder, resume=True)
    assert {name: (folder / name).read_bytes() for name in names} == whole
    truth = read_table(folder, "runs.parquet", "folder", ()).query("variant == 'truth'")
    assert set(truth["episode.kind"]) == {FREE, BRAKE}


@pytest.mark.slow
def test_a_driver_who_never_brakes_collides_and_the_page_leads_to_the_replays(tmp_path, here):
    folder = made(tmp_path / "out", density=30.0, perception="truth", driver=f"{__name__}:Reckless")
    rows = read_table(folder, "runs.parquet", "folder", ())
    assert rows[COLLIDED].sum() > 0.0
    pages = set(re.findall(r"\((kept/[^#)]*)#", (folder / "table.md").read_text()))
    assert pages
    assert all((folder / page).is_file() for page in pages)
    for kept in (folder / "kept").iterdir():
        unseen = read_table(kept, runfolder.UNSEEN, "folder", ("step", "expected"))
        assert unseen["step"].tolist() == sorted(unseen["step"])
        assert unseen["step"].iloc[0] == 0
        scores = json.loads((kept / runfolder.METRICS).read_text())["never_seen"]
        assert any(value is not None for value in scores.values())
    assert all(page in (folder / "report.html").read_text() for page in pages)


def test_what_a_fork_does_is_seen_by_nobody_and_what_it_returns_comes_back():
    kept = []
    assert worker.in_fork(lambda: [kept.append(1), len(kept)]) == [None, 1]
    assert not kept


def test_a_fork_that_fails_says_why_and_one_that_dies_says_that():
    with pytest.raises(RunError, match="ZeroDivisionError"):
        worker.in_fork(lambda: 1 / 0)
    with pytest.raises(RunError) as full:
        worker.in_fork(lambda: files.write_text(Path("/dev/full"), "no room"))
    assert files.full_disk(full.value).errno == errno.ENOSPC
    assert files.full_disk(RunError(str(full.value))) is None
    with pytest.raises(RunError, match=r"died \(exit code -9\)"):
        worker.in_fork(lambda: __import__("os").kill(__import__("os").getpid(), 9))


def test_traffic_that_can_not_be_opened_fails_every_drive_of_its_cell_in_a_row():
    cell = plan_drives(DriveRequest("truth,detections", 2, net="nowhere")).cells[0]
    rows = []
    worker.work_on_cell(cell, lambda message: rows.append(message.row) if isinstance(message, Finished) else None)
    assert len(rows) == len(cell.runs)
    assert all("nowhere" in row["error"] for row in rows)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"perception": "truth,nosuch"}, "nosuch"),
        ({"perception": "truth,"}, "`perception`"),
        ({"perception": "truth,mmpf+nonsense"}, "`perception`"),
        ({"provoke": "fog"}, "`provoke` fog"),
        ({"driver": "nosuch"}, "`driver` nosuch"),
        ({"net": "nowhere"}, "nowhere"),
        ({"density": 500.0}, "`density`"),
        ({"demand": "rush"}, "rush"),
        ({"episodes": 0}, "`episodes`"),
        ({"heed_unseen": 1.5}, "`heed_unseen`"),
        ({"flow": 1.0}, "`flow`"),
        ({"flow": 15.0, "net": "junction"}, "`net` junction"),
        ({"provoke": "stopped", "net": "junction"}, "`net` junction"),
        ({"detected": 0.0}, "`detected`"),
        ({"detected": 0.5, "provoke": "brake"}, "`detected`: only `provoke` dark uses it"),
        ({"heed_unseen": 0.1}, "`heed_unseen`: us101 has no crossings"),
    ],
)
def test_wrong_input_is_one_line_that_names_the_option_and_leaves_nothing(tmp_path, options, said):
    given = {"perception": "truth", "out": tmp_path / "out"} | options
    with pytest.raises((InputError, UnknownNameError), match=said):
        make_drives(given, "test", quiet=True)
    assert not (tmp_path / "out").exists()


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("x")
    with pytest.raises(InputError, match="`out`"):
        make_drives({"out": tmp_path / "mine", "resume": True, "perception": "truth"}, "test", quiet=True)
    with pytest.raises(InputError, match="`out`"):
        make_drives({"out": tmp_path / "mine", "perception": "truth"}, "test", quiet=True)


@pytest.mark.slow
def test_drives_over_a_crossing_are_the_same_again_and_by_the_truth_the_ego_holds_where_it_must(tmp_path, here):
    asked = {"net": "priority", "density": None, "provoke": "cross", "heed_unseen": 0.1, "seed": 103}
    rows = read_table(made(tmp_path / "first", **asked), "runs.parquet", "folder", ())
    again = read_table(made(tmp_path / "second", **asked | {"perception": "truth"}), "runs.parquet", "folder", ())
    first = rows[rows["variant"] == "truth"].reset_index(drop=True)
    pd.testing.assert_frame_equal(again, first, check_exact=True, check_dtype=False)
    crossing = rows[rows["episode.kind"] == CROSS].set_index("variant")
    assert (crossing["episode.seen_before"] == 0.0).all()
    assert crossing["drive.must_hold"]["truth"] > 0
    assert crossing["drive.unsafe_to_go_percent"]["truth"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("flow_mps", [10.0, 20.0, 30.0])
def test_who_knows_the_truth_stops_behind_a_vehicle_that_stands_in_flowing_traffic(tmp_path, here, flow_mps):
    folder = made(tmp_path / "out", density=None, provoke="stopped", flow=flow_mps, perception="truth")
    rows = read_table(folder, "runs.parquet", "folder", ())
    stopped = rows[rows["episode.kind"] == STOPPED]
    assert stopped[COLLIDED].tolist() == [0.0]
    assert (stopped["episode.provoked"] == "broken_ahead").all()
    assert (stopped["episode.flow_mps"] == flow_mps).all()


def provoked(kind, **asked):
    """Drive the provoked episode of one seed by the truth; return as ``driven`` does, and the provoked vehicle."""
    cell = plan_drives(DriveRequest("truth", 2, seed=101, provoke=kind, **asked)).cells[0]
    with worker.opened(cell) as traffic:
        at = next(at for at in worker._episodes(traffic, cell) if isinstance(at, EpisodeStart) and at.kind == kind)
        run = next(run for run in cell.runs if run.kind == kind)
        return *worker.in_fork(lambda: driven(traffic, at, run)), at.provoked


@pytest.mark.slow
def test_the_stopped_vehicle_comes_into_range_stands_and_is_in_plain_view_all_the_way():
    truth = provoked(STOPPED, flow=20.0)[1][runfolder.TRUTH]
    its = truth[truth["vehicle_id"] == "broken_ahead"]
    assert its["step"].min() == LAST_TRACKED + 1
    assert its["speed_mps"].max() == 0.0
    assert not its["in_range"].iloc[0]
    in_range = its[its["in_range"]]
    assert in_range["visible_fraction"].min() > 0.9
    ego = truth[truth["is_ego"]].set_index("step")
    gap_m = in_range["lon_m"].to_numpy() - ego.loc[in_range["step"], "lon_m"].to_numpy()
    assert gap_m[0] > 97.0
    assert gap_m[-1] < 12.0


@pytest.mark.slow
def test_a_dark_leader_is_detected_in_a_third_of_the_scans_and_brakes_to_a_stop():
    table, recorded, leader = provoked(DARK, density=30.0)
    truth, detections = recorded[runfolder.TRUTH], recorded[runfolder.DETECTIONS]
    its = truth[truth["vehicle_id"] == leader]
    seen = detections["step"][detections["truth_id"] == leader].nunique()
    assert its["visible_fraction"][its["step"] <= LAST_TRACKED].min() > 0.7
    assert its["speed_mps"].min() == 0.0
    assert 0.2 < seen / len(its) < 0.5
    assert table["drive"]["collided_percent"] == 0.0
