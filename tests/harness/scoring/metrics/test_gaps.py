"""Identity after gaps in real detections, of moving and of parked vehicles apart."""

import numpy as np
import pandas as pd
import pytest

from tests.harness.scoring.scenes import STEP_S, Scene, score_run

STEPS = 60
# Vehicle, speed, gap in its detections, whether its track goes on through the gap, whether it is parked.
SCENE = (
    ("moving kept", 10.0, range(20, 35), True, False),
    ("moving lost", 10.0, range(20, 27), False, False),
    ("parked kept", 0.0, range(20, 28), True, True),
    ("parked lost", 0.0, range(20, 40), False, True),
)


def tables(with_parked: bool = True) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    scene, step = Scene(STEPS), np.arange(STEPS)
    for number, (name, speed, gap, kept, _) in enumerate(SCENE):
        hidden = np.isin(step, list(gap))
        lon, lat = 10.0 + speed * STEP_S * step, 10.0 * number
        scene.vehicle(name, lon, lat, np.where(hidden, "hidden", "visible"), ~hidden, speed=speed)
        at = step[~hidden | kept]
        scene.track(number + np.where(kept | (at < gap[0]), 1, 11), lon[at] + 0.3, lat + 0.4, at, speed=speed, std=0.5)
    truth, detections, tracks = scene.tables()
    parked = truth["vehicle_id"].isin([name for name, *_, is_parked in SCENE if is_parked])
    return truth.assign(parked=parked) if with_parked else truth, detections, tracks


def test_gaps_are_counted_for_moving_and_parked_vehicles_apart() -> None:
    gaps = score_run(*tables(), 0).metrics["gaps"]
    for kind, counts in {"all": (4, 2, 2, 1), "moving": (2, 1, 1, 1), "parked": (2, 1, 1, 0)}.items():
        told = gaps[kind]
        assert tuple(told[key] for key in ("events", "same_id", "long_events", "long_same_id")) == counts, kind
        assert told["same_id_percent"] == pytest.approx(50.0)
        assert told["position_m"] == pytest.approx(np.hypot(0.3, 0.4))


def test_without_a_word_on_who_is_parked_there_is_no_such_score() -> None:
    assert "gaps" not in score_run(*tables(with_parked=False), 0).metrics
