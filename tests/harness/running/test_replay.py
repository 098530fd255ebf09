"""Snapshots read from a run's folder."""

import json
from dataclasses import replace

import pandas as pd
import pytest

from harness.common.errors import InputError
from harness.running.evaluate import evaluation_of
from harness.running.open import open_snapshots
from harness.running.replay import read_snapshots
from harness.running.resolve import resolve_run_config
from harness.running.snapshots import SnapshotStream
from harness.storage import run_folder as runfolder
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
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


def test_what_was_done_to_the_detections_of_a_run_is_known_of_its_replay_and_not_done_again(recorded):
    config = recorded / runfolder.CONFIG
    config.write_text(config.read_text() + "\n[altered]\nhide_s = [1.0]\nkept_probability = 0.01\n")
    replayed = resolve_run_config(options={"replay": str(recorded)})
    assert (replayed.altered.hide_s, replayed.altered.kept_probability) == ((1.0,), 0.01)
    counts = [
        [len(each.observation.scan.detections) for each in of] for of in (read(recorded), open_snapshots(replayed))
    ]
    assert counts[0] == counts[1]
    assert sum(counts[0]) > 0
    assert resolve_run_config(options={"replay": str(recorded)}, settings=["altered.ego_std_m=1"]).altered.hide_s == ()
    with pytest.raises(InputError, match=r"`hide`: vehicles are hidden on purpose in .*run already; leave `hide` out"):
        resolve_run_config(options={"replay": str(recorded), "hide": "2"})


def test_where_no_lanes_are_known_no_driver_is_asked_who_is_in_its_lane(recorded):
    config, snapshots = resolve_run_config(recorded / runfolder.CONFIG), read(recorded)
    assert evaluation_of(config, snapshots).driven is not None
    assert evaluation_of(config, replace(snapshots, road=LaneGraphRoad(graph=without_map()))).driven is None
