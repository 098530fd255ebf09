"""Tracks of a recording in KITTI's layout: boxes in the camera's frame, of what is in sight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.api import run
from harness.errors import InputError
from harness.export.formats import export_run
from tests.harness.recorded_scene import write_recorded_scene
from tests.harness.truth.recorded.detected.made import AHEAD_M, GAP, PARKED_XY, SPEED_MPS, STEPS, write_kitti


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    folder = tmp_path_factory.mktemp("kitti")
    write_kitti(folder / "data", "0007")
    run(replay=folder / "data", format="kitti-tracking", tracker="oracle-kalman", out=folder / "run")
    (written,) = export_run(folder / "run", "kitti")
    assert written.name == "0007.txt"
    lines = [line.split() for line in written.read_text().splitlines()]
    assert {line[2] for line in lines} == {"Car"}
    return np.array([[*line[:2], *line[3:]] for line in lines], dtype=float)


def test_places_are_those_of_the_tracks_in_the_camera_s_frame(rows: np.ndarray) -> None:
    ahead = rows[np.abs(rows[:, 12]) < 0.5]
    assert ahead[:, 14] == pytest.approx(np.full(len(ahead), AHEAD_M), abs=1.0)
    parked = rows[np.abs(rows[:, 12] + PARKED_XY[1]) < 0.5]
    assert parked[:, 14] == pytest.approx(PARKED_XY[0] - 0.1 * SPEED_MPS * parked[:, 0], abs=1.0)
    assert rows[:, 13] == pytest.approx(np.full(len(rows), 1.7))


def test_boxes_are_as_large_turned_and_sure_as_the_detections(rows: np.ndarray) -> None:
    assert rows[:, 9:12] == pytest.approx(np.tile([1.5, 1.8, 4.4], (len(rows), 1)))
    assert rows[:, 15] == pytest.approx(np.full(len(rows), -np.pi / 2))
    assert set(rows[:, 16]) == {8.0, 9.0}


def test_a_track_is_written_for_two_steps_without_a_detection_and_keeps_its_number(rows: np.ndarray) -> None:
    ahead = rows[rows[:, 16] == 9.0]
    steps = set(ahead[:, 0].astype(int))
    assert steps & set(GAP) == {GAP[0], GAP[0] + 1}
    assert {GAP[-1] + 1, STEPS - 1} <= steps
    assert len(set(ahead[:, 1])) == 1


def test_a_run_over_anything_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no run over a kitti-tracking recording"):
        export_run(write_recorded_scene(tmp_path / "run"), "kitti")
