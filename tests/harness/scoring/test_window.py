"""At and beyond the edge of the road on record nothing is missed and nothing is false."""

import numpy as np
import pytest

from tests.harness.scoring.scenes import Scene, score_run

STEPS = 40
WINDOW = (0.0, 100.0)


def scores_of(lon: np.ndarray, tracked_lon: np.ndarray, state="confirmed", window: bool = True):
    """Score a car in plain view and a track; a nan position is no row."""
    at, tracked = (np.flatnonzero(~np.isnan(each)) for each in (lon, tracked_lon))
    scene = Scene(STEPS).vehicle("a", lon[at], detected=True, at=at)
    truth, detections, tracks = scene.track(1, tracked_lon[tracked], at=tracked, state=state).tables()
    edges = dict(zip(("window_start_m", "window_end_m"), WINDOW, strict=True)) if window else {}
    return score_run(truth.assign(**edges), detections, tracks).metrics


def leaving_car() -> tuple[np.ndarray, np.ndarray]:
    """Return a car's record, which ends at 100 m, and its motion, which does not."""
    motion = 80.0 + 10.0 * 0.1 * np.arange(STEPS)
    return np.where(motion <= WINDOW[1], motion, np.nan), motion


@pytest.mark.parametrize("state", ["confirmed", "hidden"])
def test_a_track_that_follows_its_vehicle_over_the_edge_is_not_false(state):
    record, motion = leaving_car()
    scores = scores_of(record, motion, state)
    assert (scores["mot"]["false_tracks"], scores["mot_all"]["false_tracks"]) == (0, 0)
    assert (scores["mot"]["missed"], scores["mot_all"]["missed"]) == (0, 0)
    assert scores["mot_all"]["hota"] == pytest.approx(100.0)


def test_without_a_window_the_same_track_is_false_as_soon_as_its_vehicle_is_off_the_record():
    record, motion = leaving_car()
    scores = scores_of(record, motion, window=False)
    assert scores["mot_all"]["false_tracks"] == int(np.isnan(record).sum()) > 0


def test_a_vehicle_at_the_edge_whose_track_has_been_dropped_is_not_missed():
    record, motion = leaving_car()
    scores = scores_of(record, np.where(motion <= WINDOW[1] - 4.0, motion, np.nan))
    assert scores["mot_all"]["missed"] == 0


def test_inside_the_window_a_stray_track_is_false_and_a_vehicle_without_one_is_missed():
    scores = scores_of(np.full(STEPS, 30.0), np.full(STEPS, 70.0))
    assert scores["mot_all"]["false_tracks"] == STEPS
    assert scores["mot_all"]["missed"] == STEPS
