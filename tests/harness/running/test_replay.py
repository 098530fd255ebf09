"""Truth played back from a table is the truth that was written into it."""

import numpy as np
import pandas as pd

from harness.running.replay import COLUMNS, RecordedTruth, frames_from_table
from mmpf.road import highway


def table():
    rng = np.random.default_rng(3)
    steps = np.repeat(np.arange(4), [3, 2, 0, 3])
    rows = pd.DataFrame({name: rng.normal(size=len(steps)) for name in COLUMNS})
    return rows.assign(
        step=steps,
        time_s=steps * 0.1,
        episode=steps // 2,
        vehicle_id=["a", "b", "c", "b", "a", "a", "b", "c"],
        lane=np.arange(len(steps)) % 5,
        is_ego=[True, False, False, True, False, False, True, False],
    )


def test_every_row_comes_back_in_its_frame():
    rows = table()
    frames = list(frames_from_table(rows))
    assert [frame.step for frame in frames] == [0, 1, 3]
    for frame in frames:
        wanted = rows[rows["step"] == frame.step]
        for column in ("vehicle_id", "lon_m", "lat_m", "heading_rad", "accel_mps2", "lane", "length_m"):
            assert list(getattr(frame, column)) == list(wanted[column])
        assert frame.vehicle_id[frame.ego] == wanted.loc[wanted["is_ego"], "vehicle_id"].item()
        assert frame.episode == wanted["episode"].iloc[0]


def test_a_recording_knows_its_step_and_length():
    recording = RecordedTruth(table(), highway(5))
    assert (recording.step_s, recording.expected_steps) == (0.1, 3)
    assert len(list(recording.frames())) == 3
    recording.close()
    recording.close()


def test_a_frame_without_ego_says_so():
    assert all(frame.ego == -1 for frame in frames_from_table(table().assign(is_ego=False)))


def test_an_empty_table_has_no_frames():
    assert list(frames_from_table(table().iloc[:0])) == []
