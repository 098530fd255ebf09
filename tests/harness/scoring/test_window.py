"""At and beyond the edge of the road on record nothing is missed and nothing is false."""

import numpy as np
import pandas as pd
import pytest

from tests.harness.scoring.scenes import score_run

STEPS = 40
WINDOW = (0.0, 100.0)


def truth_of(lon_by_vehicle: dict[str, np.ndarray], window: tuple[float, float] | None = WINDOW) -> pd.DataFrame:
    """Return vehicles in plain view beside an ego; a nan position is no row."""
    rows = []
    for name, lon in {"ego": np.full(STEPS, 50.0), **lon_by_vehicle}.items():
        rows += [
            {
                "step": step, "time_s": 0.1 * step, "episode": 0, "vehicle_id": name, "lon_m": lon[step],
                "lat_m": 0.0, "speed_mps": 10.0, "lat_speed_mps": 0.0, "is_ego": name == "ego", "in_range": True,
                "state": "visible", "visible_fraction": 1.0,
            }
            for step in np.flatnonzero(~np.isnan(lon))
        ]  # fmt: skip
    table = pd.DataFrame(rows).sort_values("step", kind="stable").reset_index(drop=True)
    return table if window is None else table.assign(window_start_m=window[0], window_end_m=window[1])


def detections_of(truth: pd.DataFrame) -> pd.DataFrame:
    seen = truth[~truth["is_ego"]]
    return pd.DataFrame(
        {name: seen[name] for name in ("step", "time_s", "lon_m", "lat_m")} | {"truth_id": seen["vehicle_id"]}
    )


def tracks_of(lon_by_track: dict[int, np.ndarray], state: str = "confirmed") -> pd.DataFrame:
    rows = [
        {
            "step": step, "time_s": 0.1 * step, "track_id": number, "lon_m": lon[step], "lat_m": 0.0, "speed_mps": 10.0,
            "lat_speed_mps": 0.0, "std_lon_m": 1.0, "std_lat_m": 1.0, "std_speed_mps": 1.0, "state": state,
        }
        for number, lon in lon_by_track.items()
        for step in np.flatnonzero(~np.isnan(lon))
    ]  # fmt: skip
    return pd.DataFrame(rows)


def leaving_car() -> tuple[np.ndarray, np.ndarray]:
    """Return a car's record, which ends at 100 m, and its motion, which does not."""
    motion = 80.0 + 10.0 * 0.1 * np.arange(STEPS)
    return np.where(motion <= WINDOW[1], motion, np.nan), motion


@pytest.mark.parametrize("state", ["confirmed", "hidden"])
def test_a_track_that_follows_its_vehicle_over_the_edge_is_not_false(state):
    record, motion = leaving_car()
    truth = truth_of({"a": record})
    scores = score_run(truth, detections_of(truth), tracks_of({1: motion}, state)).metrics
    # A vehicle is in sight from its third detection on; before that its track counts as false there.
    assert scores["mot"]["false_tracks"] == 2
    assert scores["mot_all"]["false_tracks"] == 0
    assert (scores["mot"]["missed"], scores["mot_all"]["missed"]) == (0, 0)
    assert scores["mot_all"]["hota"] == pytest.approx(100.0)


def test_without_a_window_the_same_track_is_false_as_soon_as_its_vehicle_is_off_the_record():
    record, motion = leaving_car()
    truth = truth_of({"a": record}, window=None)
    scores = score_run(truth, detections_of(truth), tracks_of({1: motion})).metrics
    assert scores["mot_all"]["false_tracks"] == int(np.isnan(record).sum()) > 0


def test_a_vehicle_at_the_edge_whose_track_has_been_dropped_is_not_missed():
    record, motion = leaving_car()
    truth = truth_of({"a": record})
    tracks = tracks_of({1: np.where(motion <= WINDOW[1] - 4.0, motion, np.nan)})
    scores = score_run(truth, detections_of(truth), tracks).metrics
    assert scores["mot_all"]["missed"] == 0


def test_inside_the_window_a_stray_track_is_false_and_a_vehicle_without_one_is_missed():
    middle = np.full(STEPS, 30.0)
    truth = truth_of({"a": middle})
    scores = score_run(truth, detections_of(truth), tracks_of({1: np.full(STEPS, 70.0)})).metrics
    assert scores["mot_all"]["false_tracks"] == STEPS
    assert scores["mot_all"]["missed"] == STEPS


def test_a_track_just_outside_counts_for_the_vehicle_just_inside():
    inside = np.full(STEPS, WINDOW[1] - 4.5)
    truth = truth_of({"a": inside})
    scores = score_run(truth, detections_of(truth), tracks_of({1: inside + 1.5})).metrics
    assert scores["mot_all"]["missed"] == 0
    assert scores["mot_all"]["false_tracks"] == 0
    assert scores["mae"]["visible"]["n"] == STEPS
