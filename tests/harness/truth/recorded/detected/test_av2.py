"""Argoverse 2's cuboids become truth in the city's plane; who has three points on it is seen."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.common.errors import InputError
from harness.running.open import open_snapshots
from harness.running.resolve import resolve_run_config
from harness.truth.recorded.detected.av2 import argoverse_logs, read_av2
from harness.truth.recorded.detected.source import DriveTruth
from mmpf.scan import CAR

STEPS, CITY, YAW_RAD = 20, (1000.0, 2000.0), 0.5
UNSEEN = range(5, 12)


def quaternion(yaw_rad: float) -> dict[str, float]:
    return {"qw": np.cos(0.5 * yaw_rad), "qx": 0.0, "qy": 0.0, "qz": np.sin(0.5 * yaw_rad)}


def write_av2(folder: Path) -> Path:
    """Write one log: the car drives at 4 m/s along its yaw; one vehicle is parked, a pedestrian stands."""
    boxes, poses = [], []
    for step in range(STEPS):
        when, gone = 1_000_000_000 + 100_000_000 * step, 0.4 * step
        x, y = CITY[0] + gone * np.cos(YAW_RAD), CITY[1] + gone * np.sin(YAW_RAD)
        poses.append({"timestamp_ns": when, **quaternion(YAW_RAD), "tx_m": x, "ty_m": y, "tz_m": 3.0})
        for name, kind, place, points in (
            ("parked", "REGULAR_VEHICLE", (20.0 - gone, 3.0), 2 if step in UNSEEN else 3),
            ("walker", "PEDESTRIAN", (5.0, -3.0), 50),
        ):
            size = {"length_m": 4.5, "width_m": 1.9, "height_m": 1.6}
            where = {"tx_m": place[0], "ty_m": place[1], "tz_m": 0.0}
            of = {"timestamp_ns": when, "track_uuid": name, "category": kind, "num_interior_pts": points}
            boxes.append({**of, **size, **quaternion(0.1), **where})
    log = folder / "log"
    log.mkdir(parents=True)
    pd.DataFrame(boxes).to_feather(log / "annotations.feather")
    pd.DataFrame(poses).to_feather(log / "city_SE3_egovehicle.feather")
    return folder


def test_what_is_parked_stays_in_the_city_s_plane(tmp_path: Path) -> None:
    (drive,) = read_av2(write_av2(tmp_path))
    parked = drive.labels.take(drive.labels.counts)
    cosine, sine = np.cos(YAW_RAD), np.sin(YAW_RAD)
    assert parked.x_m == pytest.approx(np.full(STEPS, 20.0 * cosine - 3.0 * sine))
    assert parked.y_m == pytest.approx(np.full(STEPS, 20.0 * sine + 3.0 * cosine))
    assert parked.heading_rad == pytest.approx(np.full(STEPS, YAW_RAD + 0.1))
    assert set(parked.vehicle_class) == set(drive.given.vehicle_class) == {CAR}
    assert drive.ego.heading_rad == pytest.approx(np.full(STEPS, YAW_RAD))
    assert drive.ego.x_m[-1] == pytest.approx(0.4 * (STEPS - 1) * cosine)


def test_annotations_by_the_name_of_another_data_set_are_read_beside_a_log_with_the_usual_one(tmp_path: Path) -> None:
    usual, other = write_av2(tmp_path) / "log", write_av2(tmp_path / "other") / "log"
    (other / "annotations.feather").rename(other / "annotations_with_ego.feather")
    other.rename(tmp_path / "second")
    (tmp_path / "other").rmdir()
    assert argoverse_logs(tmp_path) == [usual, tmp_path / "second"]
    first, second = read_av2(tmp_path)
    np.testing.assert_array_equal(first.labels.x_m, second.labels.x_m)


def test_fewer_than_three_points_are_no_detection(tmp_path: Path) -> None:
    truth = DriveTruth(tmp_path, "av2", read_av2(write_av2(tmp_path)))
    for frame in truth.frames():
        moment = truth.moment(frame)
        assert len(moment.given) == (0 if frame.step in UNSEEN else 1)
        assert moment.unseen[list(frame.vehicle_id).index("parked")] == (frame.step in UNSEEN)


@pytest.mark.slow
def test_errors_are_drawn_from_the_seed(tmp_path: Path) -> None:
    folder = write_av2(tmp_path)

    def places(seed: int) -> list[float]:
        config = resolve_run_config(None, {"replay": str(folder), "format": "av2", "seed": seed})
        return [x for snapshot in open_snapshots(config) for x in snapshot.observation.scan.detections.lon_m.tolist()]

    assert places(1) == places(1)
    assert places(1) != places(2)
    assert np.std(np.array(places(1)) - places(2)) < 1.0


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("annotations.feather", lambda t: t.drop(columns="num_interior_pts"), "no column num_interior_pts"),
        ("annotations.feather", lambda t: t.assign(length_m=np.nan), "not finite"),
        ("annotations.feather", lambda t: t.assign(width_m=900.0), "the size of row"),
        ("annotations.feather", lambda t: t.assign(qw=3.0), "rotation's length"),
        ("annotations.feather", lambda t: pd.concat([t, t], ignore_index=True), "is there twice at 0 s"),
        ("annotations.feather", lambda t: t.assign(timestamp_ns=t.timestamp_ns * 7), "the usual step"),
        ("annotations.feather", lambda t: t.iloc[:0], "count of rows"),
        ("city_SE3_egovehicle.feather", lambda t: t.iloc[:-1], "lacks the pose"),
        ("city_SE3_egovehicle.feather", lambda t: t.assign(tx_m="far"), "tx_m holds 'far', not numbers"),
    ],
)
def test_broken_files_are_named(tmp_path: Path, name: str, change, says: str) -> None:  # type: ignore[no-untyped-def]
    path = write_av2(tmp_path) / "log" / name
    change(pd.read_feather(path)).to_feather(path)
    with pytest.raises(InputError, match=says) as error:
        read_av2(tmp_path)
    assert name in str(error.value)


def test_what_is_no_feather_or_not_there_is_named(tmp_path: Path) -> None:
    path = write_av2(tmp_path) / "log" / "city_SE3_egovehicle.feather"
    path.write_bytes(b"no feather at all")
    with pytest.raises(InputError, match="no feather file"):
        read_av2(tmp_path)
    path.unlink()
    with pytest.raises(InputError, match="does not exist"):
        read_av2(tmp_path)
    (tmp_path / "log" / "annotations.feather").unlink()
    with pytest.raises(InputError, match="has no LOG"):
        read_av2(tmp_path)


def test_a_folder_of_logs_is_a_recording_for_each_log(tmp_path: Path) -> None:
    write_av2(tmp_path / "one")
    assert argoverse_logs(tmp_path / "one") == argoverse_logs(tmp_path / "one" / "log") == [tmp_path / "one" / "log"]
    assert argoverse_logs(tmp_path) == []
