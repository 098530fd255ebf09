"""What MLflow and Trackio hold of a run and of a grid, read back through these packages."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from harness.common.errors import InputError
from harness.export.experiments import logged_runs
from harness.export.formats import export_run
from harness.storage.grid_folder import flattened
from tests.harness.recorded_scene import write_recorded_scene

TEXT = "<title>the page</title>"


@pytest.fixture(autouse=True)
def _no_store_of_the_users(monkeypatch):
    for name in ("MLFLOW_TRACKING_URI", "TRACKIO_DIR"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def run(tmp_path):
    folder = write_recorded_scene(tmp_path / "my-run")
    (folder / "report.html").write_text(TEXT)
    return folder


@pytest.fixture
def grid(tmp_path):
    """Return a grid's folder with two runs of which the second failed."""
    folder = tmp_path / "my-grid"
    folder.mkdir()
    (folder / "grid.json").write_text(
        json.dumps({"net": "us101", "duration_s": 8.0, "vary": ["sensor.range_m=40,80"], "models": None})
    )
    row = {"net": "us101", "density": 20.0, "tracker": "mmpf", "variant": "mmpf", "sensor.range_m": 40.0}
    rows = [
        row | {"seed": 0, "succeeded": True, "error": None, "mot.hota": 91.5},
        row | {"seed": 1, "succeeded": False, "error": "it fell", "mot.hota": math.nan},
    ]
    pd.DataFrame(rows).to_parquet(folder / "runs.parquet")
    return folder


def numbers_of(folder):
    """Return the finite numbers of a run's ``metrics.json`` by their keys."""
    flat = flattened(json.loads((folder / "metrics.json").read_text()))
    return {
        key: value
        for key, value in flat.items()
        if isinstance(value, int | float) and not isinstance(value, bool) and not key.startswith("run.")
    }


def in_mlflow(store, name):
    tracking = pytest.importorskip("mlflow", reason="the extra mlflow is not installed")
    client = tracking.MlflowClient(store)
    return client, client.search_runs([client.get_experiment_by_name(name).experiment_id], order_by=["tags.seed"])


def test_mlflow_returns_metrics_tags_settings_and_the_page_of_a_run(run, tmp_path):
    pytest.importorskip("mlflow", reason="the extra mlflow is not installed")
    files = export_run(run, "mlflow")
    assert all(file.is_file() for file in files)
    told = json.loads((run / "export" / "mlflow" / "logged.json").read_text())
    client, (logged,) = in_mlflow(told["store"], "my-run")
    assert told["runs"] == {logged.info.run_name: logged.info.run_id}
    assert logged.data.metrics == pytest.approx(numbers_of(run), rel=1e-12)
    assert logged.data.tags["seed"] == "7"
    assert "density" not in logged.data.tags  # its traffic is a demand
    assert logged.data.params["traffic.duration_s"] == "6.0"
    page = client.download_artifacts(logged.info.run_id, "report.html", str(tmp_path))
    assert Path(page).read_text() == TEXT
    assert export_run(run, "mlflow")  # a second time


def test_mlflow_holds_a_run_for_each_row_of_a_grid_on_the_users_own_store(grid, tmp_path, monkeypatch):
    pytest.importorskip("mlflow", reason="the extra mlflow is not installed")
    store = f"sqlite:///{tmp_path / 'own.db'}"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", store)
    assert [file.name for file in export_run(grid, "mlflow")] == ["logged.json"]
    _, (first, second) = in_mlflow(store, "my-grid")
    assert (first.info.status, second.info.status) == ("FINISHED", "FAILED")
    assert first.data.metrics == {"mot.hota": 91.5}
    assert second.data.metrics == {}
    assert second.data.tags["error"] == "it fell"
    assert {first.data.tags[key] for key in ("density", "sensor.range_m")} == {"20", "40"}
    assert first.data.params == {"net": "us101", "duration_s": "8.0", "vary.0": "sensor.range_m=40,80"}


READS = """
import json, sys, trackio
project, = trackio.SQLiteStorage.get_projects()
runs = trackio.Api().runs(project)
storage = trackio.SQLiteStorage
print(json.dumps({"project": project, "runs": [
    {"name": run.name, "config": storage.get_run_config(project, run.name),
     "metrics": storage.get_logs(project, run.name)} for run in runs]}))
"""


def in_trackio(store):
    """Return what a process that knows of a store alone reads of it."""
    said = subprocess.run(
        [sys.executable, "-c", READS], env=os.environ | {"TRACKIO_DIR": str(store)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(said.stdout.splitlines()[-1])


def test_trackio_returns_metrics_tags_settings_and_the_page(run, capfd):
    pytest.importorskip("trackio", reason="the extra trackio is not installed")
    export_run(run, "trackio")
    assert capfd.readouterr().out == ""
    folder = run / "export" / "trackio"
    told = in_trackio(json.loads((folder / "logged.json").read_text())["store"])
    (logged,) = told["runs"]
    assert told["project"] == "my-run"
    (metrics,) = logged["metrics"]
    assert {key: metrics[key] for key in numbers_of(run)} == pytest.approx(numbers_of(run), rel=1e-12)
    assert (logged["config"]["tag.seed"], logged["config"]["traffic.duration_s"]) == ("7", "6.0")
    assert [path.read_text() for path in folder.rglob("report.html")] == [TEXT]


def test_trackio_holds_a_run_for_each_row_of_a_grid_in_the_users_own_store(grid, tmp_path, monkeypatch):
    pytest.importorskip("trackio", reason="the extra trackio is not installed")
    monkeypatch.setenv("TRACKIO_DIR", str(tmp_path / "own"))
    monkeypatch.setenv("TRACKIO_SPACE_ID", "somebody/somewhere")
    assert [file.name for file in export_run(grid, "trackio")] == ["logged.json"]
    told = in_trackio(tmp_path / "own")
    assert sorted(run["config"]["tag.seed"] for run in told["runs"]) == ["0", "1"]


def test_runs_that_differ_in_an_axis_alone_have_names_of_their_own(grid):
    table = pd.read_parquet(grid / "runs.parquet").assign(seed=0)
    table.to_parquet(grid / "runs.parquet")
    assert [run.name for run in logged_runs(grid)] == ["us101-mmpf-20-s0", "us101-mmpf-20-s0-2"]


def test_a_store_that_is_none_is_one_line(run, monkeypatch):
    pytest.importorskip("mlflow", reason="the extra mlflow is not installed")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "nowhere://x")
    with pytest.raises(InputError, match="MLFLOW_TRACKING_URI=nowhere://x"):
        export_run(run, "mlflow")


@pytest.mark.parametrize("name", ["mlflow", "trackio"])
def test_a_folder_that_is_no_result_is_refused(name, tmp_path):
    pytest.importorskip(name, reason="the extra is not installed")
    with pytest.raises(InputError, match="`folder`"):
        export_run(tmp_path, name)
