"""What a worker reports of a cell, run here, and what it leaves of a run that is kept."""

import json
import tomllib
from dataclasses import replace

import pandas as pd
import pytest

from harness.analysis.coasting_ratio import COASTING_TRACKER
from harness.config.model import RunConfig
from harness.grid import worker
from harness.grid.cells import command_of
from harness.grid.grid import GridRequest, plan_grid
from harness.grid.making import keeping
from harness.grid.worker import (
    CELL,
    RUN,
    STEPPING,
    CellDone,
    Finished,
    Started,
    against_coasting,
    coasting_errors,
    work_on_cell,
)
from harness.running import evaluate
from harness.storage import ownership
from harness.storage.grid_folder import KEPT, flattened
from harness.trackers.catalogue import build_tracker
from tests.harness.grid.executors import BROKEN, ECHO
from tests.harness.scoring.scenes import score_run
from tests.harness.stand_ins import SteadyTraffic, observing, track

OPEN = observing(SteadyTraffic(steps=8))
REQUEST = GridRequest(
    densities="20", seeds="3:4", trackers=f"{ECHO},{BROKEN}:raising,{COASTING_TRACKER}", duration_s=1.0
)
(CELL_OF_THREE,) = plan_grid(REQUEST).cells


def told_of(cell, open_snapshots=OPEN) -> list:
    messages: list = []
    work_on_cell(cell, messages.append, open_snapshots)
    return messages


@pytest.fixture(scope="module")
def messages() -> list:
    return told_of(CELL_OF_THREE)


def test_a_worker_tells_what_it_begins_and_how_each_run_ended(messages):
    echo, raising, coasting = (each.key for each in CELL_OF_THREE.runs)
    assert [(type(each), getattr(each, "what", None), getattr(each, "key", None)) for each in messages] == [
        (Started, CELL, ""),
        *((Started, RUN, echo), (Started, STEPPING, echo), (Finished, None, echo)),
        *((Started, RUN, raising), (Started, STEPPING, raising), (Finished, None, raising)),
        *((Started, RUN, coasting), (Started, STEPPING, coasting), (Finished, None, coasting)),
        (CellDone, None, None),
    ]


def test_the_row_of_a_run_has_its_times_and_that_of_a_broken_one_its_reason(messages):
    row, broken, _ = (each.row for each in messages if isinstance(each, Finished))
    assert row["succeeded"]
    assert row["timing.steps"] == 8
    assert 0.0 < row["timing.tracker_ms.p50"] < 1e3 * row["total_s"] < 1e5
    assert not broken["succeeded"]
    # The tracker, and the error with its file and line.
    for words in ("FailingTracker", "ArithmeticError: the weights all vanished", "broken_trackers.py line "):
        assert words in broken["error"]
    assert 0.0 < broken["total_s"] < 100.0


def test_each_tracker_is_held_against_coasting_over_the_same_snapshots(monkeypatch):
    monkeypatch.setattr(worker, "against_coasting", lambda own, coasting: {"alike": own.equals(coasting)})
    cell = plan_grid(replace(REQUEST, trackers=f"{COASTING_TRACKER},{ECHO}")).cells[0]
    rows = [each.row for each in told_of(cell) if isinstance(each, Finished)]
    assert [row["against_coasting.alike"] for row in rows] == [True, False]


def test_the_guess_of_coasting_is_that_of_the_oracle_on_the_same_snapshots():
    snapshots = OPEN(CELL_OF_THREE.config).kept()
    tables = track(snapshots, lambda setting: build_tracker("oracle-kalman", setting, {}), 3)
    errors = score_run(tables.truth, tables.detections, tables.tracks, 3).errors
    pd.testing.assert_frame_equal(coasting_errors(snapshots, 3), errors)


def test_traffic_that_breaks_fails_every_run_with_its_reason():
    def broken(config):
        raise OSError("nothing drives there")

    begun, *finished, done = told_of(CELL_OF_THREE, broken)
    assert (begun, done) == (Started(CELL), CellDone())
    assert [each.key for each in finished] == [each.key for each in CELL_OF_THREE.runs]
    for each in finished:
        assert (each.row["succeeded"], each.row["error"]) == (False, "OSError: nothing drives there")
        assert 0.0 <= each.row["total_s"] < 10.0


def test_a_kept_run_is_a_run_folder_of_its_own(tmp_path):
    cell = plan_grid(replace(REQUEST, trackers=ECHO)).cells[0]
    passed: list = []
    keeping(lambda cells, on_row: passed.extend([*cells, on_row]), tmp_path)([cell], print)
    assert passed == [replace(cell, keep_in=(tmp_path / KEPT).resolve()), print]
    (tmp_path / "road.xml").touch()
    opened = replace(OPEN(cell.config), files={"net_file": tmp_path / "road.xml"})
    (_, *_, finished, _) = told_of(passed[0], lambda _: opened)
    folder = tmp_path / "kept" / cell.runs[0].key
    tables = {path.name: pd.read_parquet(path) for path in folder.glob("*.parquet")}
    names = [
        f"{name}.parquet"
        for name in ("truth", "detections", "tracks", "unseen", "errors", "events", "commands", "brakings")
    ]
    assert set(tables) == set(names)
    assert {path.name for path in folder.iterdir() if not path.name.startswith(".")} == {
        *("config.toml", "road.json", "metrics.json", "manifest.json", "figures"), *tables,
    }  # fmt: skip
    scored = score_run(*(tables[name] for name in names[:3]), 3)
    pd.testing.assert_frame_equal(tables["errors.parquet"], scored.errors, check_dtype=False, check_categorical=False)
    assert RunConfig.model_validate(tomllib.loads((folder / "config.toml").read_text())) == cell.runs[0].config
    metrics = json.loads((folder / "metrics.json").read_text())
    row = flattened({name: value for name, value in metrics.items() if name != "run"})
    assert {name for name in row if row[name] is not None} <= set(finished.row)
    assert [finished.row[name] for name in ("mot.hota", "timing.steps", "total_s")] == pytest.approx(
        [row["mot.hota"], 8, row["timing.total_s"]]
    )
    manifest = json.loads((folder / "manifest.json").read_text())
    assert (manifest["status"], manifest["command"]) == ("complete", command_of(cell.runs[0].config))
    assert (manifest["seed"], manifest["steps"], manifest["inputs_sha256"]) == (3, 8, opened.hashes())
    assert manifest["rows"] == {name: len(table) for name, table in tables.items()}
    assert ownership.kind_of(folder) == ownership.RUN


def test_a_run_that_is_kept_again_loses_its_manifest_first(tmp_path, monkeypatch):
    folder = tmp_path / "kept"
    folder.mkdir()
    (folder / "manifest.json").write_text("{}")

    def full(config, path) -> None:
        raise OSError("full")

    monkeypatch.setattr(evaluate, "write_config", full)
    with pytest.raises(OSError, match="full"):
        evaluate.write_run(folder, None, {}, CELL_OF_THREE.config, "")
    assert (folder / "figures").is_dir()
    assert not (folder / "manifest.json").exists()


def errors(*rows) -> pd.DataFrame:
    return pd.DataFrame([
        {
            "episode": 0, "step": step, "vehicle_id": "a", "state": "hidden", "seconds_hidden": seconds,
            "lon_error_m": error, "lat_error_m": 0.0, "speed_error_mps": 0.0, "lat_speed_error_mps": 0.0,
            "outcome": "tracked",
        }
        for step, (seconds, error) in enumerate(rows)
    ])  # fmt: skip


def test_hidden_vehicles_are_told_by_the_time_since_their_last_detection_ends_included():
    own = errors((0.1, -1.0), (1.0, 2.0), (1.1, 4.0), (3.0, 5.0), (5.0, 6.0), (5.1, 8.0))
    coasting = own.assign(lon_error_m=[3.0, -3.0, 5.0, 1.0, 1.0, 1.0])
    told = against_coasting(own, coasting)
    assert told["hidden"] == {"lon_m": 26 / 6, "coasting_lon_m": 14 / 6, "n": 6}
    assert [tuple(each.values()) for each in told["by_seconds_hidden"]] == [
        (0.0, 1.0, 1.5, 3.0, 2), (1.0, 2.0, 4.0, 5.0, 1), (2.0, 3.0, 5.0, 1.0, 1), (3.0, 5.0, 6.0, 1.0, 1),
        (5.0, 10.0, 8.0, 1.0, 1),
    ]  # fmt: skip
    seen = against_coasting(own.assign(state="visible"), coasting)
    assert seen["hidden"] == {"lon_m": None, "coasting_lon_m": None, "n": 0}
