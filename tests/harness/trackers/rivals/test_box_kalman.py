from dataclasses import replace

import numpy as np
import pytest

from harness.trackers.catalogue import build_tracker
from harness.trackers.conformance.scripted_scenes import ROAD, SENSOR, ego_at
from harness.trackers.protocol import TrackerSetting
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.road import Road
from mmpf.scan import BodyHeadings, BodySizes, Detections, EgoPose, Scan
from mmpf.tracks import CONFIRMED
from tests.mmpf.map.scenes import graph_of
from tests.mmpf.scenes import detections_at

PLANE = LaneGraphRoad(graph=graph_of({"a": [(-100.0, 0.0), (100.0, 0.0)]}))


def tracker_of(road: Road = ROAD, **options: object):
    # Not as tuned: the tests say what they need.
    options = {"longest_unseen_s": 3.0, "association": "overlap", "least_overlap": -0.4, **options}
    return build_tracker("box-kalman", TrackerSetting(road, SENSOR, np.random.default_rng(0)), options)


def detections(x, y, sizes=None, heading=None, std=0.2) -> Detections:
    found, every = detections_at(list(zip(x, y, strict=True)), std, std), np.ones(len(x))
    if sizes is not None:
        found = replace(found, sizes=BodySizes(*np.array(sizes, dtype=float).T, 0.3 * every, 0.1 * every))
    if heading is not None:
        found = replace(found, headings=BodyHeadings(heading * every, 0.05 * every, 0.1 * every))
    return found


def test_a_long_box_takes_the_detection_that_overlaps_it_though_a_shorter_one_is_nearer_by_its_middle():
    tracker = tracker_of()
    for k in range(10):
        ego = ego_at(0.1 * k)
        found = detections([ego.lon_m + 30.0, ego.lon_m + 42.0], [5.0, 5.0], [(16.0, 2.5), (4.0, 1.8)])
        tracks = tracker.step(Scan(0.1 * k, found, ego))
    lorry = tracks.track_id[np.argmin(tracks.lon_m)]
    ego = ego_at(1.0)
    # The lorry's box has slid by 4 m, its length still tells it; the car is gone.
    moved = tracker.step(Scan(1.0, detections([ego.lon_m + 34.0], [5.0], [(16.0, 2.5)]), ego))
    seen = moved.track_id[np.argmin(np.abs(moved.lon_m - ego.lon_m - 34.0))]
    assert seen == lorry


def test_a_track_ends_when_its_memory_does():
    tracker = tracker_of(longest_unseen_s=1.0)
    for k in range(5):
        tracker.step(Scan(0.1 * k, detections([ego_at(0.1 * k).lon_m + 20.0], [5.0]), ego_at(0.1 * k)))
    alive = [len(tracker.step(Scan(0.4 + 0.1 * k, detections([], []), ego_at(0.4 + 0.1 * k)))) for k in range(1, 13)]
    assert alive == [1] * 10 + [0] * 2


def test_a_front_taken_for_a_back_does_not_turn_a_box_round():
    tracker = tracker_of(PLANE)
    inner = tracker._tracker
    rng = np.random.default_rng(1)
    for k in range(30):
        heading = 1.2 + rng.normal(0.0, 0.05) + np.pi * (k % 3 == 2)
        tracker.step(Scan(0.1 * k, detections([20.0], [5.0], [(4.5, 1.8)], [heading]), EgoPose(0, 0, 0, 0, 4.7, 1.9)))
    assert inner._tracks.heading_rad[0] == pytest.approx(1.2, abs=0.05)


def test_confirmed_tracks_choose_before_newcomers():
    tracker = tracker_of()
    for k in range(6):
        ego = ego_at(0.1 * k)
        found = [ego.lon_m + 20.0] + ([ego.lon_m + 21.6] if k == 5 else [])
        tracks = tracker.step(Scan(0.1 * k, detections(found, [5.0] * len(found)), ego))
    old = tracks.track_id[tracks.state == CONFIRMED]
    ego = ego_at(0.6)
    tracks = tracker.step(Scan(0.6, detections([ego.lon_m + 21.4], [5.0]), ego))
    near = np.argmin(np.abs(tracks.lon_m - ego.lon_m - 21.4))
    assert len(old) == 1
    assert np.ptp(tracks.lon_m) > 0.5 or tracks.track_id[near] == old[0]
    lives = tracker._tracker._tracks.lives
    assert lives.last_seen_s[lives.track_id == old[0]] == pytest.approx(0.6)
