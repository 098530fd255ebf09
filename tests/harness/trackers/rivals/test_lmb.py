"""The labelled multi-Bernoulli filter of another package, against Bayes' rule for one vehicle."""

import numpy as np
import pytest

from harness.trackers.catalogue import build_tracker
from harness.trackers.conformance.scripted_scenes import ROAD, SENSOR
from harness.trackers.protocol import TrackerSetting
from mmpf.tracks import Tracks
from tests.mmpf.scenes import scan_of

pytest.importorskip("multisensor_lmb_filters_rs")


def tracks_after(pattern: str, **options: object) -> list[Tracks]:
    """Return the tracks after each scan of a car at 20 m/s: x where it is detected, - where it is not."""
    options = {"reported_existence": 0.0, "stay_s": 60.0, **options}
    tracker = build_tracker("lmb", TrackerSetting(ROAD, SENSOR, np.random.default_rng(0)), options, tuned=False)
    places = [[(30.0 + 2.0 * k, 5.0)] if letter == "x" else [] for k, letter in enumerate(pattern)]
    return [tracker.step(scan_of(0.1 * k, place)) for k, place in enumerate(places)]


def test_a_missed_vehicle_is_as_likely_as_bayes_rule_says():
    *_, before, after = tracks_after("xxxxxxxx-", detection_probability=0.8)
    (row,) = np.flatnonzero(before.existence > 0.99)
    likely = np.exp(-0.1 / 60.0) * before.existence[row]
    same = after.track_id == before.track_id[row]
    assert after.existence[same] == pytest.approx(likely * 0.2 / (1.0 - 0.8 * likely), rel=1e-6)


def test_a_vehicle_that_is_found_again_keeps_its_number():
    tracks = tracks_after("xxxxxx---xx", detection_probability=0.5)
    before, after = (each.track_id[each.existence.argmax()] for each in (tracks[5], tracks[-1]))
    assert before == after
    assert tracks[-1].existence.max() > tracks[8].existence.max()
