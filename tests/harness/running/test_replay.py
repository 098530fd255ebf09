"""Looks read from a run's folder."""

import json

import pandas as pd
import pytest

from harness.running.looks import Looks
from harness.running.replay import read_looks
from harness.running.resolve import resolve_run_config
from harness.storage import run_folder as runfolder
from tests.harness.recorded_scene import STEP_S, STEPS, write_recorded_scene


@pytest.fixture
def recorded(tmp_path):
    return write_recorded_scene(tmp_path / "run")


def read(folder) -> Looks:
    return read_looks(folder, resolve_run_config(folder / runfolder.CONFIG))


def test_a_recording_knows_its_step_length_and_files(recorded):
    looks = read(recorded)
    assert (looks.step_s, looks.expected_steps) == (STEP_S, STEPS)
    assert set(looks.hashes()) == {"replay/truth.parquet", "replay/detections.parquet", "replay/road.json"}
    looks.close()
    looks.close()


def test_each_look_holds_what_its_rows_say(recorded):
    truth = pd.read_parquet(recorded / runfolder.TRUTH)
    detections = pd.read_parquet(recorded / runfolder.DETECTIONS)
    looks = list(read(recorded))
    assert [look.frame.step for look in looks] == list(range(STEPS))
    for look in looks:
        frame, observation = look.frame, look.observation
        there, seen = (table[table["step"] == frame.step] for table in (truth, detections))
        assert list(frame.lon_m) == list(there["lon_m"])
        assert list(observation.in_range) == list(there["in_range"])
        assert list(observation.truth_id) == list(seen["truth_id"])
        assert list(observation.scan.detections.lon_m) == list(seen["lon_m"])
        assert observation.scan.time_s == frame.time_s
        assert observation.scan.ego.lon_m == there.loc[there["is_ego"], "lon_m"].item()


def test_a_step_in_which_nothing_was_detected_is_a_look_without_detections(recorded):
    path = recorded / runfolder.DETECTIONS
    detections = pd.read_parquet(path)
    detections[detections["step"] != 7].to_parquet(path)
    manifest = recorded / runfolder.MANIFEST
    manifest.write_text(json.dumps({**json.loads(manifest.read_text()), "rows": {}}))
    counts = [len(look.observation.scan.detections) for look in read(recorded)]
    assert counts[7] == 0
    assert min(counts[:7] + counts[8:]) > 0
