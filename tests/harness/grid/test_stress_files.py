"""What a stress test says, keeps and writes, in files and words that are known beforehand; the runs are made up."""

import errno
import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest
from scipy.stats import beta

import mmpf
from harness.analysis.curves import labelled
from harness.common.errors import InputError, RunError, RunInterruptedError
from harness.grid import stress
from harness.grid.cells import Cell
from harness.grid.grid import GridRequest, plan_grid
from harness.grid.making import Telling, keeping
from harness.grid.stress import FinishedGrid, run_stress
from harness.storage import ownership
from tests.harness.full_disk import disk_full_from, moments
from tests.harness.grid.executors import MadeUp

ROOT = Path(__file__).parents[3]
REQUEST = GridRequest(densities="20,40", seeds="2", trackers="mmpf,detections", models="cvm", duration_s=2.0)


@pytest.fixture(autouse=True)
def drawn(monkeypatch) -> list:
    """Let no figure be drawn: which of them are saved where, and of what, is noted."""
    noted: list = []
    monkeypatch.setattr(stress, "draw_charts", lambda *words: noted.append(words))
    for name in ("curve_charts", "hidden_charts"):
        monkeypatch.setattr(stress, name, lambda *words: words)
    return noted


@pytest.fixture(scope="module")
def whole(tmp_path_factory, no_pictures) -> Path:
    """Return the folder of a finished grid, which no test may change."""
    return grid(tmp_path_factory.mktemp("finished") / "grid").folder


@pytest.fixture
def finished(whole, tmp_path) -> Path:
    """Return a copy of it that is the test's own."""
    return shutil.copytree(whole, tmp_path / "grid")


def grid(out: Path, request: GridRequest = REQUEST, execute=None, **options) -> FinishedGrid:
    return run_stress(request, out, execute or MadeUp(), **options)


def table_of(folder: Path) -> pd.DataFrame:
    return pd.read_parquet(folder / "runs.parquet")


def telling(said: list) -> Telling:
    return Telling(True, warn=lambda line: said.append(f"warned {line}"), tell=said.append)


def test_the_summary_tells_the_grid_its_failures_and_its_curves(tmp_path, drawn):
    bad = plan_grid(REQUEST).runs[3]
    finished = run_stress(REQUEST, tmp_path / "out", MadeUp(bad.key), command="harness stress --seeds 2")
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert told == finished.summary
    assert list(told) == ["grid", "runs", "failed", "failures", "breaks", "curves"]
    assert told["grid"] == json.loads(json.dumps(REQUEST.as_table()))
    words = "net us101, density 20.0, variant detections, seed 1"
    assert (told["runs"], told["failed"]) == (8, 1)
    assert told["failures"] == [{"key": bad.key, "run": words, "error": "it broke"}]
    assert finished.failures == [f"{words}: it broke"]
    assert told["breaks"][0] == {
        "label": "mmpf cvm", "density": None, "ci95": None, "held_to": 40.0, "at_lowest": False,
    }  # fmt: skip
    (hota,) = (each for each in told["curves"] if (each["label"], each["value"], each["metric"])
               == ("detections", 40.0, "mot.hota"))  # fmt: skip
    assert (hota["axis"], hota["mean"], hota["seeds"], hota["n"]) == ("density", 80.0, 2, 2)
    # Two equal values are no certainty: as 1.6 of two, exactly.
    assert hota["ci95"] == pytest.approx([100.0 * beta.ppf(0.025, 1.6, 1.4), 100.0 * beta.ppf(0.975, 2.6, 0.4)])
    text = (tmp_path / "out" / "table.md").read_text()
    assert text.startswith("# Stress test on us101\n\n")
    assert text.endswith(f"\n## Runs that failed\n\n- {words}: it broke\n")
    assert (finished.folder, finished.title) == (tmp_path / "out", "Stress test on us101")
    assert [(of[1:], title, path) for of, title, path in drawn] == [
        (("density",), "Stress test on us101", tmp_path / "out" / "figures" / "over_density.png")
    ]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert [manifest[key] for key in ("status", "command", "seed", "steps")] == [
        "complete", "harness stress --seeds 2", 0, 8,
    ]  # fmt: skip
    assert ownership.kind_of(tmp_path / "out") == ownership.STRESS
    runs = pd.read_parquet(tmp_path / "out" / "runs.parquet")
    assert runs["total_s"].tolist() == [2.5] * 3 + [1.5] + [2.5] * 4
    assert runs["error"].dropna().to_dict() == {3: "it broke"}


def stopped(out, after: int) -> None:
    with pytest.raises(
        Exception, match=f"^interrupted after {after} of 8 runs; continue with the same command and `resume`$"
    ):
        run_stress(REQUEST, out, MadeUp(stop_after=after))


def test_what_an_interrupted_grid_lacks_is_made_and_nothing_else(tmp_path):
    out = tmp_path / "out"
    stopped(out, 3)
    manifest = json.loads((out / "manifest.json").read_text())
    assert (manifest["status"], manifest["steps"]) == ("interrupted", 0)
    for name in ("runs.parquet", "summary.json", "table.md"):
        (out / name).write_text("old")
    execute = MadeUp(stop_after=2)
    with pytest.raises(Exception, match=r"^interrupted after 5 of 8 runs"):
        run_stress(REQUEST, out, execute, resume=True)
    assert sum(len(cell.runs) for cell in execute.cells) == 5
    assert all(isinstance(cell, Cell) and cell.keep_in is None for cell in execute.cells)
    assert json.loads((out / "manifest.json").read_text())["steps"] == 3
    assert not any((out / name).exists() for name in ("runs.parquet", "summary.json", "table.md"))


@pytest.mark.parametrize(("retry", "again"), [(False, 0), (True, 1)])
def test_failed_runs_are_made_again_only_where_that_is_asked_for(retry, again, tmp_path):
    bad = plan_grid(REQUEST).runs[3].key
    run_stress(REQUEST, tmp_path / "out", MadeUp(bad))
    execute = MadeUp()
    told = run_stress(REQUEST, tmp_path / "out", execute, resume=True, **({"retry_failed": True} if retry else {}))
    assert [run.key for cell in execute.cells for run in cell.runs] == [bad] * again
    assert told.summary["failed"] == 1 - again


@pytest.mark.parametrize(("changed", "what"), [
    ({"versions": {"numpy": "0"}}, "numpy"),
    ({"code_sha256": {"mmpf": "0", "harness/truth": "1"}}, "mmpf, harness/truth"),
    ({"code_sha256": {}, "git_revision": "abc"}, "revision"), (None, "it is not known which"),
])  # fmt: skip
def test_runs_of_another_version_are_warned_of(changed, what, tmp_path):
    out, said = tmp_path / "out", []
    stopped(out, 3)
    run_stress(REQUEST, out, MadeUp(), resume=True, user=telling(said))
    assert said == ["3 runs are kept, 5 are made"]
    manifest = json.loads((out / "manifest.json").read_text())
    (out / "manifest.json").write_text("no more" if changed is None else json.dumps(manifest | changed))
    run_stress(REQUEST, out, MadeUp(), resume=True, user=telling(said))
    assert said[1:] == [
        f"warned the 8 runs that {out} holds were made by another version of the software ({what}); is that meant?",
        "8 runs are kept, 0 are made",
    ]


MODULE = """
from tests.harness.stand_ins import echo_tracker
make = echo_tracker
"""


def test_only_the_runs_of_a_tracker_whose_module_changed_are_made_again_and_that_is_said(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    module = tmp_path / "my_changing_tracker.py"
    module.write_text(MODULE)
    request = replace(REQUEST, trackers="mmpf,my_changing_tracker:make")
    out, said, again = tmp_path / "out", [], MadeUp()
    run_stress(request, out, MadeUp())
    module.write_text(MODULE + "# confirmed after two detections\n")
    run_stress(request, out, again, resume=True, user=telling(said))
    assert {run.variant for cell in again.cells for run in cell.runs} == {"my_changing_tracker:make"}
    assert said == [
        "warned my_changing_tracker has changed since 4 runs with it were made; they are made again",
        "4 runs are kept, 4 are made",
    ]
    run_stress(request, out, MadeUp(), resume=True, user=telling(said))
    assert said[2:] == ["8 runs are kept, 0 are made"]


def test_runs_on_a_network_that_was_edited_are_made_again_and_that_is_said(tmp_path):
    net = shutil.copytree(ROOT / "networks" / "us101", tmp_path / "net")
    request, out, said, again = replace(REQUEST, net=str(net)), tmp_path / "out", [], MadeUp()
    run_stress(request, out, MadeUp())
    run_stress(request, out, MadeUp(), resume=True, user=telling(said))
    (net / "network.toml").write_text((net / "network.toml").read_text() + "# edited\n")
    run_stress(request, out, again, resume=True, user=telling(said))
    assert len(again.cells) == 4
    assert said[0] == "8 runs are kept, 0 are made"
    assert said[1] == f"warned {net} has changed since 8 runs with it were made; they are made again"


def test_a_fitted_model_is_part_of_a_runs_label_and_of_what_is_made_again(tmp_path):
    file = tmp_path / "keeping.npz"
    shutil.copyfile(next(Path(mmpf.__path__[0]).rglob("lane_keeping.npz")), file)
    request = replace(REQUEST, trackers="mmpf", models="gmm", settings=(f"tracker.model_file={file}",))
    out, said, again = tmp_path / "out", [], MadeUp()
    run_stress(request, out, MadeUp())
    (label,) = set(labelled(pd.read_parquet(out / "runs.parquet"))["label"])
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    assert label == f"mmpf gmm keeping.npz {digest[:8]}"
    assert json.loads((out / "manifest.json").read_text())["inputs_sha256"][str(file)] == digest
    file.write_bytes(file.read_bytes() + b" ")
    run_stress(request, out, again, resume=True, user=telling(said))
    assert len(again.cells) == 4
    assert said[0] == f"warned {file} has changed since 4 runs with it were made; they are made again"


def test_every_recording_is_read_once_before_any_run(tmp_path, monkeypatch):
    opened: list = []
    files = [tmp_path / name for name in ("a.csv", "b.csv")]
    runs = [SimpleNamespace(config=SimpleNamespace(replay=path, sensor=None)) for path in (*files, *files)]

    def open_snapshots(config):
        opened.append(config.replay)
        return SimpleNamespace(report=f"read {config.replay.name}")

    monkeypatch.setattr("harness.grid.stress.open_snapshots", open_snapshots)
    monkeypatch.setattr(stress, "_check_sensors_and_trackers", lambda grid: None)
    said: list = []
    stress.check_grid(SimpleNamespace(cells=runs, is_replay=True), said.append)
    assert (opened, said) == (files, ["read a.csv", "read b.csv"])


def test_an_interrupted_grid_taken_up_again_equals_an_uninterrupted_one(whole, tmp_path):
    for stop in (0, 3, 7):
        folder = tmp_path / f"stopped-{stop}"
        with pytest.raises(RunInterruptedError, match=f"{stop} of 8 runs.*`resume`"):
            grid(folder, execute=MadeUp(stop_after=stop))
        rest = MadeUp()
        pd.testing.assert_frame_equal(table_of(grid(folder, execute=rest, resume=True).folder), table_of(whole))
        assert rest.rows == 8 - stop


def test_runs_that_were_made_without_folders_are_told_of_where_folders_are_kept(finished):
    said: list[str] = []
    grid(finished, execute=keeping(MadeUp(), finished, said.append), resume=True)
    assert [line.partition(";")[0] for line in said] == [f"finished runs in {finished} without a folder: 8"]


def test_a_resumed_grid_may_have_more_seeds(finished):
    more = MadeUp()
    larger = GridRequest(**{**REQUEST.__dict__, "seeds": "3"})
    assert len(table_of(grid(finished, larger, more, resume=True).folder)) == 12
    assert more.rows == 4


def test_half_written_files_of_a_killed_grid_are_removed(finished):
    (finished / "kept" / "a run" / "figures").mkdir(parents=True)
    (finished / "notes").mkdir()
    for folder in (".", "runs", "figures", "kept", "kept/a run", "kept/a run/figures", "notes"):
        (finished / folder / ".left.json.123.partial").write_text("{")
    grid(finished, resume=True)
    assert [path.parent.name for path in finished.rglob("*.partial")] == ["notes"]


GRID_WRITES = 15
"""How many files a grid of eight runs writes: ledger, manifest, request, rows, tables, manifest again."""


@pytest.mark.parametrize("write", moments(GRID_WRITES))
def test_a_grid_whose_disk_fills_ends_in_one_line_and_is_taken_up_as_if_it_had_not(write, whole, tmp_path):
    with (
        disk_full_from(write) as written,
        pytest.raises(RunError, match=r"can't continue \(.*No space left on device\); \d of 8 runs are kept.*`resume`"),
    ):
        grid(tmp_path / "grid")
    rows = {path.stem for path in (tmp_path / "grid" / "runs").iterdir()}
    assert rows == {name.removesuffix(".json") for name in written if (tmp_path / "grid" / "runs" / name).is_file()}
    rest = MadeUp()
    pd.testing.assert_frame_equal(table_of(grid(tmp_path / "grid", execute=rest, resume=True).folder), table_of(whole))
    assert rest.rows == 8 - len(rows)


def test_a_run_that_met_a_full_disk_is_none_that_failed_but_one_to_make_again(whole, tmp_path):
    full = MadeUp(plan_grid(REQUEST).runs[3].key, why=OSError(errno.ENOSPC, "", "tracks.parquet"))
    with pytest.raises(RunError, match=r"can't continue \(No space left on device\); \d of 8 runs are kept.*`resume`"):
        grid(tmp_path / "grid", execute=full)
    pd.testing.assert_frame_equal(table_of(grid(tmp_path / "grid", resume=True).folder), table_of(whole))


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
