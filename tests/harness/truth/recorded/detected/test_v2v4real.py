"""V2V4Real's boxes are in the moving frame of the recording car."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.running.open import open_looks
from harness.running.resolve import resolve_run_config
from harness.truth.recorded.detected.source import DriveTruth
from harness.truth.recorded.detected.v2v4real import read_v2v4real

SIZE, STEPS = "1.5 1.9 4.5", 12


def write_v2v4real(folder: Path) -> Path:
    """Write one sequence: a car that stays 10 m ahead and 3 m to the left, one that is left behind at 5 m/s."""
    labels, detections = [], []
    for step in range(STEPS):
        places = (10.0, 3.0), (20.0 - 0.5 * step, -3.0)
        for number, (x, left) in enumerate(places):
            box = f"{SIZE} {x} -1 {left} {3.2 if number else 0.0}"
            labels.append(f"{step} {number + 5} Car 0 0 0 0 0 0 0 {box}")
            detections.append(",".join([str(step), "2", *"0000", f"0.{8 - number}", *box.split(), "0.0"]))
        detections.append(",".join([str(step), "2", *"0000", "0.1", *f"{SIZE} 50 -1 9 0".split(), "0.0"]))
    for name, lines in (("label_02", labels), ("detection", detections)):
        (folder / name).mkdir(parents=True)
        (folder / name / "0000.txt").write_text("\n".join(lines) + "\n")
    return folder


def test_boxes_lie_ahead_and_to_the_left_as_their_numbers_say(tmp_path: Path) -> None:
    (drive,) = read_v2v4real(write_v2v4real(tmp_path))
    first = drive.labels.take(drive.labels.step == 0)
    assert first.x_m.tolist() == [10.0, 20.0]
    assert first.y_m.tolist() == [3.0, -3.0]
    assert first.heading_rad == pytest.approx([0.0, 3.2 - 2.0 * np.pi])
    assert len(drive.ego) == STEPS


def test_speeds_are_against_the_recording_car_and_nobody_is_parked(tmp_path: Path) -> None:
    truth = DriveTruth(tmp_path, "v2v4real", read_v2v4real(write_v2v4real(tmp_path)))
    for frame in truth.frames():
        speed = dict(zip(frame.vehicle_id.tolist(), frame.speed_mps.tolist(), strict=True))
        assert speed["ego"] == 0.0
        assert speed["5"] == pytest.approx(0.0, abs=1e-9)
        assert speed["6"] == pytest.approx(5.0, rel=0.01)
        assert frame.parked is not None
        assert not frame.parked.any()


def test_directions_are_not_given_where_boxes_do_not_move_as_they_point(tmp_path: Path) -> None:
    options = {"replay": str(write_v2v4real(tmp_path)), "format": "v2v4real"}
    for look in open_looks(resolve_run_config(None, options)):
        assert look.observation.scan.detections.headings is None
        assert sorted(look.observation.truth_id) == ["5", "6"]


@pytest.mark.parametrize(("name", "says"), [("detection", "is missing"), ("label_02", "has no label_02")])
def test_a_missing_file_is_named(tmp_path: Path, name: str, says: str) -> None:
    folder = write_v2v4real(tmp_path)
    (folder / name / "0000.txt").unlink()
    with pytest.raises(InputError, match=says):
        read_v2v4real(folder)
