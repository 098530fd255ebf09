"""Whole closed loops: the same beginning for every belief, the same bytes again, and gaps that seem too long."""

import re

import pytest

from harness.closedloop import worker
from harness.closedloop.episode import drive
from harness.closedloop.handover import HandOver
from harness.closedloop.plan import BRAKE, CROSS, FREE, GAP, DriveRequest, plan_drives
from harness.commands.drive import make_drives
from harness.errors import InputError, RunError
from harness.grid.worker import Finished
from harness.runfolder.folder import read_table
from harness.scoring.closedloop import COLLIDED
from mmpf.registry import UnknownNameError

LAST_TRACKED = 50
SMALL = {"density": 15.0, "beliefs": "truth,detections", "episodes": 2, "seed": 100, "workers": 1}


def made(out, **options):
    return make_drives({"out": out, **SMALL, **options}, "test", quiet=True).folder


@pytest.mark.slow
def test_every_belief_begins_with_the_same_traffic_and_detections_and_then_goes_its_own_way():
    cell = plan_drives(DriveRequest("truth,detections,driverstate", 1, seed=100, density=30.0)).cells[0]
    tables = {}
    with worker.opened(cell) as traffic:
        at = next(worker._episodes(traffic, cell))
        for run in cell.runs:
            tables[run.variant] = worker.in_fork(lambda run=run: drive(traffic, at, run)).tables
    whole = tables["truth"].truth
    assert whole["step"].max() > LAST_TRACKED
    for name, other in tables.items():
        for kind in ("truth", "detections"):
            mine, theirs = (getattr(each, kind) for each in (tables["truth"], other))
            mine, theirs = (each[each["step"] <= LAST_TRACKED].reset_index(drop=True) for each in (mine, theirs))
            assert mine.equals(theirs), (name, kind)
        assert name == "truth" or not whole.equals(other.truth)


@pytest.mark.slow
def test_the_same_command_leaves_the_same_bytes_and_so_does_one_that_was_killed_and_taken_up(tmp_path):
    first, second = made(tmp_path / "first"), made(tmp_path / "second")
    names = ("runs.parquet", "table.md", "summary.json")
    whole = {name: (first / name).read_bytes() for name in names}
    assert {name: (second / name).read_bytes() for name in names} == whole
    rows = sorted((second / "runs").iterdir())
    for path in (*rows[::2], *(second / name for name in names)):
        path.unlink()
    rows[1].with_name(".half.tmp").write_text("{")
    made(second, resume=True)
    assert {name: (second / name).read_bytes() for name in names} == whole
    truth = read_table(first, "runs.parquet", "folder", ()).query("variant == 'truth'")
    assert set(truth["episode.kind"]) == {FREE, BRAKE}


@pytest.mark.slow
def test_collisions_grow_with_the_bias_of_the_gaps_and_the_page_leads_to_replays_of_them(tmp_path):
    folder = made(tmp_path / "out", density=30.0, beliefs="truth", gap_bias="0,10")
    rows = read_table(folder, "runs.parquet", "folder", ())
    collided = [rows[COLLIDED][rows["gap_bias_m"] == bias].sum() for bias in (0.0, 10.0)]
    assert collided[0] == 0.0
    assert collided[-1] > 0.0
    pages = set(re.findall(r"\((kept/[^#)]*)#", (folder / "table.md").read_text()))
    assert pages
    assert all((folder / page).is_file() for page in pages)
    assert all(page in (folder / "report.html").read_text() for page in pages)


def test_what_a_fork_does_is_seen_by_nobody_and_what_it_returns_comes_back():
    kept = []
    assert worker.in_fork(lambda: [kept.append(1), len(kept)]) == [None, 1]
    assert not kept


def test_a_fork_that_fails_says_why_and_one_that_dies_says_that():
    with pytest.raises(RunError, match="ZeroDivisionError"):
        worker.in_fork(lambda: 1 / 0)
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
        ({"beliefs": "truth,nosuch"}, "nosuch"),
        ({"driver": "nosuch"}, "`driver` nosuch"),
        ({"net": "nowhere"}, "nowhere"),
        ({"density": 500.0}, "`density`"),
        ({"demand": "rush"}, "rush"),
        ({"episodes": 0}, "`episodes`"),
        ({"gap_bias": "x"}, "`gap_bias`"),
        ({"heed_unseen": 1.5}, "`heed_unseen`"),
    ],
)
def test_wrong_input_is_one_line_that_names_the_option_and_leaves_nothing(tmp_path, options, said):
    given = {"beliefs": "truth", "out": tmp_path / "out"} | options
    with pytest.raises((InputError, UnknownNameError), match=said) as error:
        make_drives(given, "test", quiet=True)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("x")
    with pytest.raises(InputError, match="`out`"):
        make_drives({"out": tmp_path / "mine", "resume": True, "beliefs": "truth"}, "test", quiet=True)
    with pytest.raises(InputError, match="`out`"):
        make_drives({"out": tmp_path / "mine", "beliefs": "truth"}, "test", quiet=True)


@pytest.mark.slow
def test_whoever_knows_of_the_hidden_car_leaves_it_the_gap_and_whoever_does_not_takes_it():
    cell = plan_drives(DriveRequest("truth,detections", 2, seed=101, density=30.0, provoke=GAP)).cells[0]
    with worker.opened(cell) as traffic:
        at = next(at for at in worker._episodes(traffic, cell) if isinstance(at, HandOver) and at.kind == GAP)
        runs = [run for run in cell.runs if run.kind == GAP]
        drove = {run.variant: worker.in_fork(lambda run=run: drive(traffic, at, run)).table["drive"] for run in runs}
    assert (drove["truth"]["forbidden_change_percent"], drove["truth"]["collided_percent"]) == (0.0, 0.0)
    assert drove["truth"]["unsafe_gaps_percent"] == 0.0
    assert drove["detections"]["forbidden_change_percent"] == 100.0
    assert drove["detections"]["unsafe_gaps_percent"] > 10.0


@pytest.mark.slow
def test_drives_over_a_crossing_are_the_same_bytes_again_and_by_the_truth_the_ego_holds_where_it_must(tmp_path):
    asked = {"net": "priority", "density": None, "provoke": "cross", "heed_unseen": 0.1, "seed": 103}
    first, second = (made(tmp_path / name, **asked) for name in ("first", "second"))
    assert (first / "runs.parquet").read_bytes() == (second / "runs.parquet").read_bytes()
    rows = read_table(first, "runs.parquet", "folder", ())
    crossing = rows[rows["episode.kind"] == CROSS].set_index("variant")
    assert (crossing["episode.seen_before"] == 0.0).all()
    assert crossing["drive.must_hold"]["truth"] > 0
    assert crossing["drive.unsafe_to_go_percent"]["truth"] == 0.0
