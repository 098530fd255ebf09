"""Snapshots read from a run's folder."""

import json

import pandas as pd
import pytest

from harness.running.replay import read_snapshots
from harness.running.resolve import resolve_run_config
from harness.running.snapshots import SnapshotStream
from harness.storage import run_folder as runfolder
from tests.harness.recorded_scene import STEP_S, STEPS, write_recorded_scene


@pytest.fixture
def recorded(tmp_path):
    return write_recorded_scene(tmp_path / "run")


def read(folder) -> SnapshotStream:
    return read_snapshots(folder, resolve_run_config(folder / runfolder.CONFIG))


def test_a_recording_knows_its_step_length_and_files(recorded):
    snapshots = read(recorded)
    assert (snapshots.step_s, snapshots.expected_steps) == (STEP_S, STEPS)
    assert set(snapshots.hashes()) == {"replay/truth.parquet", "replay/detections.parquet", "replay/road.json"}
    snapshots.close()
    snapshots.close()


def test_each_snapshot_holds_what_its_rows_say(recorded):
    truth = pd.read_parquet(recorded / runfolder.TRUTH)
    detections = pd.read_parquet(recorded / runfolder.DETECTIONS)
    snapshots = list(read(recorded))
    assert [snapshot.frame.step for snapshot in snapshots] == list(range(STEPS))
    for snapshot in snapshots:
        frame, observation = snapshot.frame, snapshot.observation
        there, seen = (table[table["step"] == frame.step] for table in (truth, detections))
        assert list(frame.lon_m) == list(there["lon_m"])
        assert list(observation.in_range) == list(there["in_range"])
        assert list(observation.truth_id) == list(seen["truth_id"])
        assert list(observation.scan.detections.lon_m) == list(seen["lon_m"])
        assert observation.scan.time_s == frame.time_s
        assert observation.scan.ego.lon_m == there.loc[there["is_ego"], "lon_m"].item()


def test_a_step_in_which_nothing_was_detected_is_a_snapshot_without_detections(recorded):
    path = recorded / runfolder.DETECTIONS
    detections = pd.read_parquet(path)
    detections[detections["step"] != 7].to_parquet(path)
    manifest = recorded / runfolder.MANIFEST
    manifest.write_text(json.dumps({**json.loads(manifest.read_text()), "rows": {}}))
    counts = [len(snapshot.observation.scan.detections) for snapshot in read(recorded)]
    assert counts[7] == 0
    assert min(counts[:7] + counts[8:]) > 0
