"""Expected against counted vehicles that no track stands for."""

import numpy as np
import pandas as pd
import pytest

from harness.scoring.evidence.unseen import _distances
from harness.scoring.metrics.never_seen import NAME
from tests.harness.scoring.scenes import Scene, score_run

STEPS = np.arange(60)
PLACES = 100.0, 125.0


def stretches(expected, steps=range(0, 60, 5), lon=PLACES, lat_m=0.0):
    """One stretch of lane from 100 to 125 m, with what is expected on it at each step."""
    step = np.array(list(steps))
    columns = {"from_lon_m": lon[0], "from_lat_m": lat_m, "to_lon_m": lon[1], "to_lat_m": lat_m, "expected": expected}
    return pd.DataFrame({"step": step, "time_s": step / 10, "episode": 0, "stretch": 4, **columns})


def scored(scene, unseen):
    return score_run(*scene.tables(), unseen=unseen).metrics[NAME]


def test_a_vehicle_that_was_never_detected_counts_where_it_is():
    told = scored(Scene(60).vehicle("a", lon=110.0, detected=False), stretches(0.5))
    assert told["counted"] == 1.0
    assert told["expected_over_counted"] == pytest.approx(0.5)
    assert told["slope"] == pytest.approx(2.0)
    assert told["stretches"] == 12


@pytest.mark.parametrize("lon", [99.0 - 3.0, 126.0 + 3.0])
def test_one_beside_the_stretch_does_not(lon):
    assert scored(Scene(60).vehicle("a", lon=lon, detected=False), stretches(0.5))["counted"] == 0.0


@pytest.mark.parametrize("lon", [110.0, np.where(STEPS < 10, 110.0, 140.0)], ids=["followed", "displaced"])
def test_one_that_has_a_track_of_its_own_is_known(lon):
    scene = Scene(60).vehicle("a", lon=110.0, detected=STEPS < 10).track(7, lon=lon)
    assert scored(scene, stretches(0.5))["counted"] == 0.0


@pytest.mark.parametrize("detected", range(3, 23))
def test_one_whose_track_was_let_go_is_unknown_when_a_second_has_passed_since_its_last_detection(detected):
    # In floating point, some of these seconds are a bit longer than one.
    scene = Scene(60).vehicle("a", lon=110.0, detected=detected > STEPS).track(7, lon=110.0, at=STEPS[: detected + 5])
    assert scored(scene, stretches(0.5, steps=range(60)))["counted"] == pytest.approx((50 - detected) / 60)


def test_right_probabilities_have_the_skill_of_the_plain_formula():
    rng = np.random.default_rng(0)
    probability = rng.uniform(0.01, 0.9, 60)
    occupied = rng.random(60) < probability
    scene = Scene(60).vehicle("a", lon=np.where(occupied, 110.0, 160.0), detected=False)
    told = scored(scene, stretches(-np.log1p(-probability), steps=range(60)))
    share = occupied.mean()
    loss = -np.where(occupied, np.log(probability), np.log1p(-probability)).mean()
    usual = -(share * np.log(share) + (1 - share) * np.log(1 - share))
    assert told["log_skill_percent"] == pytest.approx(100 * (1 - loss / usual))
    brier = ((probability - occupied) ** 2).mean() / (share * (1 - share))
    assert told["brier_skill_percent"] == pytest.approx(100 * (1 - brier))


def test_the_curve_holds_all_stretches_once():
    expected = np.geomspace(1e-3, 3.0, 12)
    curve = scored(Scene(60).vehicle("a", lon=110.0, detected=False), stretches(expected))["curve"]
    assert sum(row["stretches"] for row in curve) == 12
    known = [row["expected"] for row in curve if row["stretches"]]
    assert known == sorted(known)


def test_nobody_asked_nothing_told():
    assert NAME not in score_run(*Scene(60).vehicle("a", lon=110.0).tables()).metrics


def test_distances_are_those_of_a_dense_search():
    rng = np.random.default_rng(1)
    places, lines = rng.uniform(-20, 20, (30, 2)), rng.uniform(-20, 20, (7, 4))
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    for column, line in enumerate(lines):
        dense = line[:2] + share * (line[2:] - line[:2])
        nearest = np.hypot(*(places[:, None] - dense).transpose(2, 0, 1)).min(axis=1)
        np.testing.assert_allclose(_distances(*places.T, lines)[:, column], nearest, atol=0.01)
