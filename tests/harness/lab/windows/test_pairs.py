"""Recorded traffic as windows: pairs and whole recordings, against what they were made of."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from harness.common.errors import InputError
from harness.lab.windows.car_following import following_windows
from harness.lab.windows.pairs import pair_windows, recording_of
from harness.truth.recorded.source import open_recorded_traffic
from tests.harness.lab.fit.recorded_pairs import FOLLOWER_LENGTH_M, LEADER_LENGTH_M, pair_rows, write_pairs
from tests.harness.truth.recorded.layouts import Car, ngsim_rows, write_ngsim_csv

STEP_S = 0.1
EDGE = slice(40, 141)


def test_the_gap_of_a_pair_runs_from_the_followers_front_to_the_leaders_rear(tmp_path):
    rows = pair_rows("1-2", 18.0, gap_m=15.0)
    windows = pair_windows(write_pairs(tmp_path / "pairs.parquet", [rows]), 101, STEP_S)
    assert len(windows) == 1
    wanted = (rows["preceding_local_y"] - LEADER_LENGTH_M - rows["local_y"]).to_numpy()[EDGE]
    np.testing.assert_allclose(windows.gap_m[0], wanted)
    np.testing.assert_allclose(windows.lon_m[0], rows["local_y"][EDGE] - 0.5 * FOLLOWER_LENGTH_M)
    np.testing.assert_array_equal(windows.leader_speed_mps[0], rows["preceding_vel"][EDGE])


def test_accelerations_of_pairs_are_the_slopes_of_their_speeds(tmp_path):
    rows = pair_rows("1-2", 18.0)
    windows = pair_windows(write_pairs(tmp_path / "pairs.parquet", [rows]), 101, STEP_S)
    inner = slice(6, -6)
    np.testing.assert_allclose(windows.accel_mps2[0, inner], np.gradient(rows["v_vel"], STEP_S)[EDGE][inner], atol=0.03)


def test_the_ends_of_a_record_are_left_out(tmp_path):
    """The source's smoothing swings in there."""
    rows = pair_rows("1-2", 20.0)
    swung = rows.assign(v_vel=rows["v_vel"].where((rows["time"] > 3.95) & (rows["time"] < 16.05), 0.0))
    windows = pair_windows(write_pairs(tmp_path / "pairs.parquet", [swung]), 101, STEP_S)
    assert len(windows) == 1
    assert windows.speed_mps.min() > 7.0
    np.testing.assert_allclose(np.diff(windows.lon_m), 0.1 * windows.speed_mps[:, :-1], atol=0.02)


def test_every_pair_follows_its_own_leader_and_keeps_its_number(tmp_path):
    pairs = [pair_rows(name, 29.0, gap) for name, gap in (("1-2", 10.0), ("2-3", 20.0), ("3-4", 30.0))]
    windows = pair_windows(write_pairs(tmp_path / "pairs.parquet", pairs), 101, STEP_S)
    assert np.bincount(windows.vehicle).tolist() == [2, 2, 2]
    for number, rows in enumerate(pairs):
        wanted = (rows["preceding_local_y"] - LEADER_LENGTH_M - rows["local_y"]).iloc[EDGE]
        np.testing.assert_allclose(windows.gap_m[windows.vehicle == number][0], wanted)


def test_no_window_runs_over_a_hole_in_the_record(tmp_path):
    rows = pair_rows("1-2", 41.0)
    holed = rows[(rows["time"] < 20.0) | (rows["time"] > 21.0)]
    windows = pair_windows(write_pairs(tmp_path / "pairs.parquet", [holed]), 101, STEP_S)
    assert len(windows) == 2
    assert (np.abs(np.diff(windows.lon_m, axis=1)) < 1.3).all()


def test_sideways_a_pair_counts_from_the_median_of_its_lane_to_the_left(tmp_path):
    right, left = pair_rows("1-2", 18.0), pair_rows("3-4", 18.0)
    right["local_x"], left["local_x"] = 6.0, 5.0
    windows = pair_windows(write_pairs(tmp_path / "pairs.parquet", [right, left]), 101, STEP_S)
    np.testing.assert_allclose(windows.offset_m[:, 0], [-0.5, 0.5])


@pytest.mark.parametrize("column", ["pair_id", "v_vel", "preceding_length"])
def test_a_missing_column_is_named(column, tmp_path):
    path = write_pairs(tmp_path / "pairs.parquet", [pair_rows("1-2", 18.0).drop(columns=column)])
    with pytest.raises(InputError, match=column):
        pair_windows(path, 101, STEP_S)


def test_a_file_that_is_no_table_is_refused_in_one_line(tmp_path):
    path = tmp_path / "pairs.parquet"
    path.write_bytes(b"no parquet at all")
    with pytest.raises(InputError) as refused:
        pair_windows(path, 101, STEP_S)
    assert len(str(refused.value).splitlines()) == 1


def test_windows_of_recorded_traffic_have_the_leader_that_drives_ahead(tmp_path):
    cars = (Car(1, 40.0, 9.0, 10.0), Car(2, 70.0, 9.0, 10.0, length_m=6.5), Car(3, 55.0, 5.0, 10.0))
    path = write_ngsim_csv(tmp_path / "scene.csv", ngsim_rows(cars))
    traffic = open_recorded_traffic(path, "ngsim", "us101", "auto", 60.0).traffic
    windows = following_windows(recording_of(traffic), traffic.road, 51, STEP_S)
    led = windows.take(np.flatnonzero(windows.has_leader))
    assert len(windows) == 3
    assert len(led) == 1
    np.testing.assert_allclose(led.gap_m, 30.0 - 0.5 * (4.5 + 6.5), atol=1e-5)


def test_rows_may_stand_in_any_order(tmp_path):
    rows = pair_rows("1-2", 18.0)
    shuffled = rows.sample(frac=1.0, random_state=1)
    first = pair_windows(write_pairs(tmp_path / "a.parquet", [rows]), 101, STEP_S)
    second = pair_windows(write_pairs(tmp_path / "b.parquet", [pd.DataFrame(shuffled)]), 101, STEP_S)
    np.testing.assert_array_equal(first.lon_m, second.lon_m)
