"""Tracks of a recording in KITTI's layout: boxes in the camera's frame, of what is in sight."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harness.api import run
from harness.common.errors import InputError
from harness.export import kitti
from harness.export.formats import export_run
from tests.harness.recorded_scene import write_recorded_scene
from tests.harness.truth.recorded.detected.made import AHEAD_M, GAP, PARKED_XY, SPEED_MPS, STEPS, write_kitti

pytestmark = [pytest.mark.usefixtures("no_pictures"), pytest.mark.slow]


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    folder = tmp_path_factory.mktemp("kitti")
    write_kitti(folder / "data", "0007")
    run(replay=folder / "data", format="kitti-tracking", tracker="oracle-kalman", out=folder / "run")
    written, script = export_run(folder / "run", "kitti")
    assert (written.name, script.name) == ("0007.txt", "score.py")
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
    assert min(steps) == 2, "until its third detection the track is tentative"
    assert steps & set(GAP) == {GAP[0], GAP[0] + 1}
    assert {GAP[-1] + 1, STEPS - 1} <= steps
    assert len(set(ahead[:, 1])) == 1


def test_a_run_over_anything_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not made from a kitti-tracking recording"):
        export_run(write_recorded_scene(tmp_path / "run"), "kitti")


SEEN, SURE, UNSURE = 10, 9.0, 1.0


@pytest.fixture
def scored(tmp_path: Path) -> tuple[str, ...]:
    """What the script says of a car found in each of its frames, and of a false object as long, at two least scores."""
    pytest.importorskip("trackeval", reason="TrackEval is the reader of this format")
    picture, box = "100 100 200 200", "1.5 1.8 4.4 0 1.7 20 0"
    elsewhere = "700 100 800 200"
    labels, tracks = tmp_path / "label_02", tmp_path / "data_0"
    labels.mkdir()
    tracks.mkdir()
    truth = [f"{step} 1 Car 0 0 0 {picture} {box}\n" for step in range(SEEN)]
    found = [
        f"{step} {number} Car 0 0 0 {where} {box} {score}\n"
        for step in range(SEEN)
        for number, where, score in ((1, picture, SURE), (2, elsewhere, UNSURE))
    ]
    (labels / "0007.txt").write_text("".join(truth))
    (tracks / "0007.txt").write_text("".join(found))
    shutil.copyfile(Path(kitti.__file__).with_name(kitti.SCRIPT), tmp_path / "score.py")
    command = [sys.executable, str(tmp_path / "score.py"), str(labels), "0", "5"]
    return tuple(subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines())


def test_the_script_beside_the_files_has_trackeval_score_them_from_a_least_score_on(scored: tuple[str, ...]) -> None:
    every, sure = ([float(word) for word in line.split()] for line in scored[1:])
    # Half of the boxes are false: DetA is 1/2, and HOTA the root of it.
    assert every == pytest.approx([0.0, 100 * np.sqrt(0.5), 50.0, 100.0, 0.0, 200 / 3, 0.0], abs=0.01)
    assert sure == pytest.approx([5.0, 100.0, 100.0, 100.0, 100.0, 100.0, 0.0])


def test_the_script_says_in_one_line_that_labels_are_missing(tmp_path: Path) -> None:
    pytest.importorskip("trackeval", reason="TrackEval is the reader of this format")
    (tmp_path / "data_0").mkdir()
    (tmp_path / "data_0" / "0007.txt").touch()
    shutil.copyfile(Path(kitti.__file__).with_name(kitti.SCRIPT), tmp_path / "score.py")
    done = subprocess.run(
        [sys.executable, str(tmp_path / "score.py"), str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].endswith("has no 0007.txt; give KITTI's folder label_02")
    assert "Traceback" not in done.stderr
