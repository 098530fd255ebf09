"""KITTI tracking's files become truth in one plane, and detections that know what they are of."""

from pathlib import Path

import numpy as np
import pytest

from harness.commands.app import run_command_line
from harness.common.errors import InputError
from harness.truth.recorded.detected.kitti import read_kitti
from harness.truth.recorded.detected.origin import NOTHING, origins
from harness.truth.recorded.detected.source import DriveTruth, motion_of
from mmpf.scan import CAR, UNKNOWN_CLASS
from tests.harness.truth.recorded.detected.made import AHEAD_M, GAP, PARKED_XY, SPEED_MPS, STEPS, write_kitti


def test_what_stands_stays_where_it_is_although_the_camera_moves(tmp_path: Path) -> None:
    (drive,) = read_kitti(write_kitti(tmp_path))
    parked = drive.labels.take(drive.labels.thing == 0)
    assert parked.x_m == pytest.approx(np.full(STEPS, PARKED_XY[0]), abs=1e-5)
    assert parked.y_m == pytest.approx(np.full(STEPS, PARKED_XY[1]), abs=1e-5)
    assert parked.heading_rad == pytest.approx(np.zeros(STEPS), abs=1e-7)
    assert (parked.length_m == 4.4).all()
    assert (parked.width_m == 1.8).all()


def test_a_turned_camera_sees_the_same_plane(tmp_path: Path) -> None:
    folder = write_kitti(tmp_path, steps=2)
    (straight,) = read_kitti(folder)
    # The second frame's camera is turned by 30 degrees to the left, and what it sees with it.
    angle = np.deg2rad(30.0)
    turn = np.array([[np.cos(angle), 0.0, -np.sin(angle)], [0.0, 1.0, 0.0], [np.sin(angle), 0.0, np.cos(angle)]])
    pose = np.column_stack([turn, [0.0, 0.0, 0.5]])
    lines = (folder / "poses" / "0000.txt").read_text().splitlines()
    lines[1] = " ".join(f"{value:.12f}" for value in pose.ravel())
    (folder / "poses" / "0000.txt").write_text("\n".join(lines))
    for name, first, separator in (("label_02", 13, " "), ("detection", 10, ",")):
        path, rows = folder / name / "0000.txt", []
        for line in path.read_text().splitlines():
            words = line.split(separator)
            if words[0] == "1" and "DontCare" not in words:
                seen = turn.T @ np.array(words[first : first + 3], dtype=float)
                words[first : first + 3] = [f"{value:.12f}" for value in seen]
                words[first + 3] = f"{float(words[first + 3]) + angle:.12f}"
            rows.append(separator.join(words))
        path.write_text("\n".join(rows))
    (turned,) = read_kitti(folder)
    for column in ("x_m", "y_m", "heading_rad"):
        assert getattr(turned.labels, column) == pytest.approx(getattr(straight.labels, column), abs=1e-6)
        assert getattr(turned.given, column) == pytest.approx(getattr(straight.given, column), abs=1e-6)
    assert turned.ego.heading_rad[1] == pytest.approx(angle)


def test_speeds_are_those_over_ground_and_tell_the_parked_car(tmp_path: Path) -> None:
    (drive,) = read_kitti(write_kitti(tmp_path))
    motion = motion_of(drive.labels)
    parked, moving = drive.labels.thing == 0, drive.labels.thing == 1
    assert motion.speed_mps[parked] == pytest.approx(np.zeros(STEPS), abs=1e-4)
    assert motion.speed_mps[moving] == pytest.approx(np.full(STEPS, SPEED_MPS), abs=1e-4)
    assert motion.parked[parked].all()
    assert not motion.parked[moving].any()


def test_detections_are_of_the_nearest_thing_and_others_are_false(tmp_path: Path) -> None:
    (drive,) = read_kitti(write_kitti(tmp_path))
    assert set(drive.given.vehicle_class) == {CAR}
    assert set(drive.labels.vehicle_class) == {CAR, UNKNOWN_CLASS}
    origin = origins(drive)
    of = np.where(origin == NOTHING, NOTHING, drive.labels.thing[origin])
    assert (of[drive.given.score == 8.0] == 0).all()
    assert (of[drive.given.score == 9.0] == 1).all()
    assert (of[drive.given.score == 0.5] == NOTHING).all()
    assert set(drive.given.step[of == 1]) == set(range(STEPS)) - set(GAP)


def test_a_vehicle_without_detections_for_half_a_second_is_unseen(tmp_path: Path) -> None:
    truth = DriveTruth(tmp_path, "kitti-tracking", read_kitti(write_kitti(tmp_path)))
    for frame in truth.frames():
        moment = truth.moment(frame)
        unseen = set(frame.vehicle_id[moment.unseen])
        assert ("2" in unseen) == (frame.step in GAP)
        assert "1" not in unseen
        assert not moment.counts[list(frame.vehicle_id).index("3")]


def test_the_ego_comes_first_and_drives_as_its_poses_say(tmp_path: Path) -> None:
    truth = DriveTruth(tmp_path, "kitti-tracking", read_kitti(write_kitti(tmp_path)))
    frame = list(truth.frames())[-1]
    assert frame.ego == 0
    assert frame.ego_pose.lon_m == pytest.approx((STEPS - 1) * 0.1 * SPEED_MPS)
    assert frame.ego_pose.speed_mps == pytest.approx(SPEED_MPS)
    ahead = frame.lon_m[list(frame.vehicle_id).index("2")] - frame.lon_m[0]
    assert ahead == pytest.approx(AHEAD_M)


def test_a_folder_of_sequences_is_played_drive_by_drive(tmp_path: Path) -> None:
    write_kitti(tmp_path, "0003", 5)
    truth = DriveTruth(tmp_path, "kitti-tracking", read_kitti(write_kitti(tmp_path, "0001", 7)))
    assert [drive.drive.name for drive in truth.drives] == ["0001", "0003"]
    assert [frame.episode for frame in truth.frames()] == [0] * 7 + [1] * 5
    assert [drive.name for drive in read_kitti(tmp_path / "label_02" / "0003.txt")] == ["0003"]


def spoil(folder: Path, kind: str, line: int, word: int, value: str, separator: str = " ") -> Path:
    path = folder / kind / "0000.txt"
    lines = path.read_text().splitlines()
    words = lines[line].split(separator)
    words[word] = value
    lines[line] = separator.join(words)
    path.write_text("\n".join(lines))
    return path


def test_labels_that_leap_are_refused(tmp_path: Path) -> None:
    folder = write_kitti(tmp_path)
    for line in range(0, 40, 5):
        spoil(folder, "label_02", line, 13, "300")
    with pytest.raises(InputError, match="leaps at"):
        read_kitti(folder)


@pytest.mark.parametrize(
    ("kind", "line", "word", "value", "says"),
    [
        ("label_02", 1, 13, "nan", "'nan' is not a number"),
        ("label_02", 1, 13, "far", "'far' is not a number"),
        ("label_02", 1, 13, "1_0", "'1_0' is not a number"),
        ("label_02", 1, 13, "1e9", "the place of row"),
        ("label_02", 1, 12, "700", "the size of row"),
        ("label_02", 1, 0, "999", "poses of 60 frames"),
        ("label_02", 1, 0, "1.5", "whole number"),
        ("label_02", 1, 0, "1e18", "the frame of row"),
        ("label_02", 1, 1, "2", "2 is there twice at 0 s"),
        ("label_02", 1, 1, "-4", "number of a thing"),
        ("detection", 0, 7, "-1", "the size of row"),
        ("poses", 3, 0, "2", "pose 3"),
        ("poses", 3, 0, "inf", "'inf' is not a number"),
    ],
)
def test_broken_files_are_named_with_what_is_wrong(
    tmp_path: Path, kind: str, line: int, word: int, value: str, says: str
) -> None:
    folder = write_kitti(tmp_path)
    path = spoil(folder, kind, line, word, value, "," if kind == "detection" else " ")
    with pytest.raises(InputError, match=says) as error:
        read_kitti(folder)
    assert str(path) in str(error.value)


@pytest.mark.parametrize("kind", ["detection", "poses"])
def test_a_missing_file_is_named(tmp_path: Path, kind: str) -> None:
    folder = write_kitti(tmp_path)
    (folder / kind / "0000.txt").unlink()
    with pytest.raises(InputError, match=f"{kind}/0000.txt does not exist"):
        read_kitti(folder)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--sensor", "radar"], "brings its own detections"),
        (["--ego", "7"], "seen from its own car"),
        (["--net", "us101"], "brings its own road"),
        (["--set", "traffic.recording.start_s=99"], "has ended by then"),
    ],
)
def test_what_the_recording_leaves_no_choice_of_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], says: str
) -> None:
    folder = write_kitti(tmp_path / "data")
    command = ["run", "--replay", str(folder), "--format", "kitti-tracking", "--out", str(tmp_path / "run")]
    assert run_command_line([*command, *options]) == 2
    told = capsys.readouterr().err.strip()
    assert says in told
    assert "\n" not in told
    assert not (tmp_path / "run").exists()
