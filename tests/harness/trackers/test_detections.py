"""The baseline without memory: detections in, the same out."""

import numpy as np

from harness.trackers.catalogue import build_tracker
from harness.trackers.conformance.requirements import follow
from harness.trackers.conformance.scripted_scenes import ROAD, SENSOR, busy_scene
from harness.trackers.protocol import TrackerSetting


def build(seed):
    return build_tracker("detections", TrackerSetting(ROAD, SENSOR, np.random.default_rng(seed)), {})


def test_every_scan_is_reported_as_it_is_under_new_identities():
    seen = set()
    for labelled, tracks in zip(busy_scene(), follow(build, busy_scene()), strict=True):
        found = labelled.scan.detections
        assert tracks.lon_m.tolist() == found.lon_m.tolist()
        assert tracks.std_lat_m.tolist() == found.std_lat_m.tolist()
        assert not seen & set(tracks.track_id.tolist())
        seen |= set(tracks.track_id.tolist())


def test_a_speed_that_is_not_measured_is_the_egos():
    (scan, *_) = busy_scene()
    (tracks, *_) = follow(build, busy_scene())
    measured = np.isfinite(scan.scan.detections.speed_mps)
    expected = np.where(measured, scan.scan.detections.speed_mps, scan.scan.ego.speed_mps)
    assert tracks.speed_mps.tolist() == expected.tolist()
