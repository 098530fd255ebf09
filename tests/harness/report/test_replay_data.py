import base64
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from harness.report import replay_data as module
from harness.report.replay_data import NO_ERROR_CM, replay_data
from harness.running.finished import read_recorded_run
from tests.harness.recorded_scene import GIVEN_UP, LAST_SEEN, STEPS, rewrite, write_recorded_scene


def unpacked(column):
    return np.frombuffer(base64.b64decode(column["data"]), dtype=f"<{column['type']}")


def course(data, name):
    """Return the rows of a vehicle, one a step."""
    rows = unpacked(data["truth"]["vehicle"]) == data["vehicles"]["names"].index(name)
    return {key: unpacked(column)[rows] for key, column in data["truth"].items() if key != "first"}


def test_every_shown_row_is_found_by_its_step(run):
    data = replay_data(run)
    assert data["time_s"] == pytest.approx(run.truth["time_s"].unique())
    first = unpacked(data["truth"]["first"])
    assert first.tolist() == list(range(0, 3 * STEPS + 1, 3))
    assert unpacked(data["tracks"]["first"])[-1] == len(run.tracks)
    lon = run.tracks["lon_m"].to_numpy()
    assert unpacked(data["tracks"]["lon"]) == pytest.approx(lon, abs=1e-4)


def test_vehicles_far_beyond_the_sensor_are_left_out(run):
    assert set(replay_data(run)["vehicles"]["names"]) == {"ego", "near", "far"}


def test_shadows_are_cast_by_the_measured_sizes_or_else_by_mean_cars(run):
    unmeasured = replay_data(run)["detections"]
    assert set(unpacked(unmeasured["length"]).tolist()) == {470}
    assert set(unpacked(unmeasured["width"]).tolist()) == {190}
    lengths = np.linspace(4.0, 18.0, len(run.detections))
    measured = run.detections.assign(length_m=lengths, width_m=2.5)
    packed = replay_data(replace(run, detections=measured))["detections"]
    assert unpacked(packed["length"]) == pytest.approx(100 * lengths, abs=0.51)
    assert set(unpacked(packed["width"]).tolist()) == {250}


def test_each_vehicle_bears_its_error_track_and_fate(run):
    data = replay_data(run)
    far = course(data, "far")
    assert far["error"][LAST_SEEN] == 10
    assert far["error"][LAST_SEEN + 1] == 300
    assert far["track"][LAST_SEEN + 1] == 2
    assert far["error"][GIVEN_UP] == NO_ERROR_CM
    assert data["outcomes"][far["outcome"][GIVEN_UP]] == "lost"
    assert far["visible"][LAST_SEEN] == 100
    assert far["visible"][LAST_SEEN + 1] == 0
    assert (course(data, "ego")["outcome"] == 0).all()


def test_a_run_too_long_for_a_page_is_shown_in_fewer_steps(run, monkeypatch):
    whole = replay_data(run)
    monkeypatch.setattr(module, "MOST_BYTES", 4_000)
    data = replay_data(run)
    stride = round(len(whole["time_s"]) / len(data["time_s"]))
    assert stride > 1
    assert data["time_s"] == whole["time_s"][::stride]
    assert course(data, "near")["lon"].tolist() == course(whole, "near")["lon"][::stride].tolist()
    ((vehicle, begin, end, outcome),) = data["events"]
    assert (data["vehicles"]["names"][vehicle], outcome) == ("far", "lost")
    assert data["time_s"][begin] == pytest.approx(2.0, abs=0.1 * stride)
    assert data["time_s"][end] == pytest.approx(4.0, abs=0.1 * stride)


def test_particles_lie_where_they_were_recorded(run):
    particles = pd.DataFrame({"step": [0, 0, 2], "lon_m": [90.0, 131.26, 104.0], "lat_m": [5.0, -1.25, 7.5]})
    data = replay_data(replace(run, particles=particles))["particles"]
    assert unpacked(data["first"]).tolist()[:4] == [0, 2, 2, 3]
    # The ego is at 100 m at the start and at 104 m two steps later.
    assert unpacked(data["away"]) / 10 == pytest.approx([-10.0, 31.3, 0.0], abs=0.051)
    ego = run.truth[run.truth["is_ego"]].set_index("step")["lat_m"]
    assert unpacked(data["lat"]) / 100 == pytest.approx(np.array([5.0, -1.25, 7.5]) - ego[[0, 0, 2]], abs=0.0051)
    assert replay_data(run)["particles"] is None


def test_expected_unseen_vehicles_stand_at_the_shown_step_after_them(run):
    columns = ["step", "time_s", "episode", "from_lon_m", "from_lat_m", "to_lon_m", "to_lat_m", "expected"]
    first = run.truth["step"].iloc[0]
    table = pd.DataFrame([(first, 0.0, 0, 10.0, 1.0, 35.0, 2.0, 0.25)], columns=columns)
    packed = replay_data(replace(run, unseen=table))["unseen"]
    assert unpacked(packed["first"])[:2].tolist() == [0, 1]
    assert unpacked(packed["expected"]).tolist() == [250]
    assert unpacked(packed["to_lon"]).tolist() == [35.0]
    assert replay_data(replace(run, unseen=None))["unseen"] is None


def test_ramps_are_the_ground_beside_the_main_lanes_on_which_vehicles_drive(tmp_path):
    folder = write_recorded_scene(tmp_path / "run")
    truth = pd.read_parquet(folder / "truth.parquet")
    truth.loc[truth["vehicle_id"] == "near", "lat_m"] = -30.0
    rewrite(folder, "truth.parquet", truth)
    run = read_recorded_run(folder)
    (outline,) = run.ramps
    own = truth[truth["vehicle_id"] == "near"]
    assert outline[:, 1].min() == pytest.approx(-31.83)
    assert outline[:, 1].max() == pytest.approx(-28.17)
    assert outline[:, 0].max() - outline[:, 0].min() == pytest.approx(own["lon_m"].max() - own["lon_m"].min() + 3.66)
