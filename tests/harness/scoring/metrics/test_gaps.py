"""Identity after gaps in real detections, of moving and of parked vehicles apart."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from tests.harness.scoring.scenes import score_run

STEPS, STEP_S = 60, 0.1
# Vehicle, speed, gap in its detections, whether its track goes on through the gap, whether it is parked.
SCENE = (
    ("moving kept", 10.0, range(20, 35), True, False),
    ("moving lost", 10.0, range(20, 27), False, False),
    ("parked kept", 0.0, range(20, 28), True, True),
    ("parked lost", 0.0, range(20, 40), False, True),
)


def tables(with_parked: bool = True) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    truth, detections, tracks = [], [], []
    for step in range(STEPS):
        when = {"step": step, "time_s": round(step * STEP_S, 6), "episode": 0}
        ego = {"lon_m": 0.0, "lat_m": 0.0, "speed_mps": 0.0, "is_ego": True, "state": "visible", "in_range": True}
        truth.append({**when, "vehicle_id": "ego", **ego, "parked": False})
        for number, (name, speed, gap, kept, parked) in enumerate(SCENE):
            place = {"lon_m": 10.0 + speed * step * STEP_S, "lat_m": 10.0 * number}
            state = "hidden" if step in gap else "visible"
            about = {"speed_mps": speed, "is_ego": False, "state": state, "in_range": True}
            truth.append({**when, "vehicle_id": name, **place, **about, "parked": parked})
            if step not in gap:
                detections.append({**when, **place, "truth_id": name})
            identity = number + 1 if kept or step < gap[0] else number + 11
            if kept or step not in gap:
                off = {"lon_m": place["lon_m"] + 0.3, "lat_m": place["lat_m"] + 0.4}
                tracks.append({**when, "track_id": identity, **off, "speed_mps": speed, "state": "confirmed"})
    made = [pd.DataFrame(rows) for rows in (truth, detections, tracks)]
    made[0]["lat_speed_mps"] = 0.0
    for name in ("lat_speed_mps", "std_lon_m", "std_lat_m", "std_speed_mps"):
        made[2][name] = 0.5
    return made[0] if with_parked else made[0].drop(columns="parked"), made[1], made[2]


def test_gaps_are_counted_for_moving_and_parked_vehicles_apart() -> None:
    gaps = score_run(*tables(), 0).metrics["gaps"]
    for kind, events, same_id, long_events, long_same_id in (
        ("all", 4, 2, 2, 1),
        ("moving", 2, 1, 1, 1),
        ("parked", 2, 1, 1, 0),
    ):
        told = gaps[kind]
        assert (told["events"], told["same_id"]) == (events, same_id), kind
        assert (told["long_events"], told["long_same_id"]) == (long_events, long_same_id), kind
        assert told["same_id_percent"] == pytest.approx(50.0)
        assert told["position_m"] == pytest.approx(np.hypot(0.3, 0.4))


def test_without_a_word_on_who_is_parked_there_is_no_such_score() -> None:
    assert "gaps" not in score_run(*tables(with_parked=False), 0).metrics
