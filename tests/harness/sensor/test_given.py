"""Detections on record are handed out as they are, with what they say of themselves."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.grid.grid import GridRequest
from harness.grid.stress import run_stress
from harness.running.open import open_snapshots
from harness.running.resolve import resolve_run_config
from harness.running.snapshots import SnapshotStream
from harness.storage.schema import HIDDEN, OUT, VISIBLE
from tests.harness.grid.executors import InProcess
from tests.harness.truth.recorded.detected.made import GAP, PARKED_XY, STEPS, write_kitti

pytestmark = pytest.mark.usefixtures("no_pictures")


def snapshots_from(folder: Path, *settings: str) -> SnapshotStream:
    options = {"replay": str(write_kitti(folder)), "format": "kitti-tracking"}
    return open_snapshots(resolve_run_config(None, options, settings)).kept()


def test_a_snapshot_has_the_detections_of_its_frame(tmp_path: Path) -> None:
    for snapshot in snapshots_from(tmp_path):
        detections = snapshot.observation.scan.detections
        of_parked = snapshot.observation.truth_id == "1"
        assert of_parked.sum() == 1
        assert detections.lon_m[of_parked] == pytest.approx(PARKED_XY[0], abs=1e-4)
        assert detections.lat_m[of_parked] == pytest.approx(PARKED_XY[1], abs=1e-4)
        assert detections.sizes.length_m[of_parked] == pytest.approx(4.4)
        assert np.isnan(detections.speed_mps).all()
        detections.validate()


def test_low_scores_are_left_out_as_the_user_says(tmp_path: Path) -> None:
    assert all(len(snapshot.observation.scan.detections) <= 2 for snapshot in snapshots_from(tmp_path / "usual"))
    every = snapshots_from(tmp_path / "all", "traffic.recording.least_score=0")
    assert all((snapshot.observation.truth_id == "").sum() == 1 for snapshot in every)


def test_who_is_not_detected_is_hidden_and_who_is_no_vehicle_is_out(tmp_path: Path) -> None:
    for snapshot in snapshots_from(tmp_path):
        state = dict(zip(snapshot.frame.vehicle_id.tolist(), snapshot.observation.state.tolist(), strict=True))
        assert state["1"] == VISIBLE
        assert state["2"] == (HIDDEN if snapshot.frame.step in GAP else VISIBLE)
        assert state["3"] == OUT


def test_outside_of_the_camera_s_view_no_place_is_free(tmp_path: Path) -> None:
    scan = snapshots_from(tmp_path).kept().stream[0].observation.scan  # type: ignore[index]
    bearing = np.deg2rad(np.arange(-179.75, 180.0, 0.5))
    behind = np.abs(bearing) > np.deg2rad(41.5)
    assert (scan.free_space.range_m[behind] == 0.0).all()
    assert (scan.free_space.range_m[~behind] > 0.0).any()


def test_equal_snapshots_whatever_the_seed(tmp_path: Path) -> None:
    one, other = snapshots_from(tmp_path / "a", "seed=1"), snapshots_from(tmp_path / "b", "seed=2")
    assert len(list(one)) == STEPS
    for left, right in zip(one, other, strict=True):
        assert (left.observation.scan.detections.lon_m == right.observation.scan.detections.lon_m).all()


@pytest.mark.parametrize("tracker", [pytest.param("mmpf", marks=pytest.mark.slow), "oracle-kalman"])
def test_trackers_run_over_a_recording_and_a_run_of_it_again(tmp_path: Path, tracker: str) -> None:
    from harness.api import run  # noqa: PLC0415

    folder = write_kitti(tmp_path / "data")
    first = run(replay=folder, format="kitti-tracking", tracker=tracker, out=tmp_path / "run", settings={"seed": 3})
    assert first.metrics.loc["mot.truth_n", "value"] > 0
    again = run(replay=tmp_path / "run", tracker=tracker, out=tmp_path / "again")
    for name in ("tracks.parquet", "truth.parquet", "detections.parquet"):
        assert (tmp_path / "run" / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name
    scores = [finished.metrics.loc["mot.hota":"occlusion.events", "value"] for finished in (first, again)]  # type: ignore[misc]
    pd.testing.assert_series_equal(*scores)


@pytest.mark.slow
def test_a_grid_over_sequences_tells_gaps_of_moving_and_parked_vehicles(tmp_path: Path) -> None:
    write_kitti(tmp_path / "data", "0001")
    folder = write_kitti(tmp_path / "data", "0002") / "label_02"
    files = tuple(map(str, sorted(folder.iterdir())))
    settings = ('traffic.recording.format="kitti-tracking"',)
    request = GridRequest(net=None, replay=files, trackers="oracle-kalman", seeds="1", settings=settings)
    assert not run_stress(request, tmp_path / "grid", InProcess(open_snapshots)).failures
    table = (tmp_path / "grid" / "table.md").read_text()
    assert "same identity after gaps of 1 s and more, moving, %" in table
    assert "| 0001.txt |" in table
