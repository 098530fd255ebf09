"""Each vehicle's part in a run's metric: the metric itself, its derivative, and who drives beside whom."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from harness.comparison.single import _of_sides
from harness.comparison.vehicles import (
    REACH_M,
    ByVehicle,
    _hota_influence,
    closeness,
    hidden_cost_by_vehicle,
    hota_by_vehicle,
    ratio_by_vehicle,
    same_identity_by_vehicle,
)
from harness.scoring.evidence import Evidence, gather
from harness.scoring.metrics import score_metrics
from harness.scoring.quantity import Quantity
from harness.scoring.settings import ScoringSettings

CARS = 6


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    """Return what is known of six cars in two lanes, of which two are hidden for a time, under a wandering tracker."""
    rng, truth, detections, tracks = np.random.default_rng(3), [], [], []
    for step in range(80):
        for car in range(CARS):
            hidden = car in (2, 5) and 40 <= step < 60
            place = {
                "step": step,
                "time_s": 0.1 * step,
                "lon_m": 2.0 * step + 40.0 * (car // 2),
                "lat_m": 4.0 * (car % 2),
            }
            speed = {"speed_mps": 20.0, "lat_speed_mps": 0.0}
            state = "hidden" if hidden else "visible"
            who = {"vehicle_id": str(car), "is_ego": False, "in_range": True, "state": state}
            truth.append(place | speed | who)
            if not hidden:
                detections.append(place | {"truth_id": str(car)})
            if rng.random() < 0.9 and not (car == 5 and step > 45):
                number = car + 10 * (step > 50 and car == 1)
                deviations = {"std_lon_m": 0.5, "std_lat_m": 0.5, "std_speed_mps": 0.5}
                off = {"lon_m": place["lon_m"] + rng.normal(), "lat_m": place["lat_m"] + 0.3 * rng.normal()}
                tracks.append(place | off | speed | deviations | {"track_id": number, "state": "confirmed"})
    return gather(pd.DataFrame(truth), pd.DataFrame(detections), pd.DataFrame(tracks), ScoringSettings(), 0)


@pytest.mark.parametrize(
    ("of", "table", "name"),
    [
        (hota_by_vehicle, "mot", "hota"),
        (hidden_cost_by_vehicle, "hidden", "hidden_cost_m"),
        (same_identity_by_vehicle, "occlusion", "same_id_percent"),
    ],
)
def test_the_value_is_the_metric_and_the_parts_of_all_cancel(evidence, of, table, name):
    found = of(evidence, CARS)
    assert found.value == pytest.approx(score_metrics(evidence)[table][name])
    assert found.influence.sum() + found.others.sum() == pytest.approx(0.0, abs=1e-9)
    assert np.abs(found.influence).max() > 0.0


def test_the_influence_on_hota_is_its_derivative_along_a_units_weight():
    rng = np.random.default_rng(4)
    truths, tracks = rng.integers(20, 60, (2, 5)).astype(float)
    matched = np.minimum(truths, tracks)[:, None] * np.array([0.9, 0.7, 0.2])
    associated = matched * rng.uniform(0.3, 0.9, (5, 1))

    def hota(weight: np.ndarray) -> float:
        of_all, union = weight @ associated, weight @ (truths + tracks) - weight @ matched
        return float(np.sqrt(of_all / union).mean())

    step = 1e-6
    numeric = [(hota(np.ones(5) + step * unit) - hota(np.ones(5) - step * unit)) / (2.0 * step) for unit in np.eye(5)]
    np.testing.assert_allclose(_hota_influence(truths, tracks, matched, associated), numeric, rtol=1e-5)


def test_a_mean_over_rows_is_taken_apart_by_vehicles():
    found = ratio_by_vehicle(np.array([1.0, 3.0, 8.0]), np.array([0, 0, 2]), 4)
    assert found.value == 4.0
    np.testing.assert_allclose(found.influence, [(4.0 - 8.0) / 3.0, 0.0, (8.0 - 4.0) / 3.0, 0.0])
    np.testing.assert_allclose(found.counts, [2.0, 0.0, 1.0, 0.0])


def test_closeness_falls_along_the_road_and_nobody_is_closer_than_to_oneself(evidence):
    near = closeness(evidence.rows.truth, CARS)
    np.testing.assert_allclose(np.diagonal(near), 1.0)
    np.testing.assert_allclose(near, near.T)
    # Cars 0 and 1 drive side by side, 2 is 40 m ahead of them.
    assert near[0, 1] == pytest.approx(1.0)
    assert near[0, 2] == pytest.approx(1.0 - 40.0 / REACH_M)
    assert np.linalg.eigvalsh(near).min() > -1e-9


def test_what_belongs_to_no_vehicle_widens_the_deviation_of_a_difference_and_who_counts_nowhere_is_left_out():
    counts = np.append(np.ones(8), 0.0)
    away = np.append(np.tile([0.5, -0.5], 4), 0.0)
    first, second = (ByVehicle(value, part * away, counts, np.zeros(0)) for value, part in ((10.0, 1.0), (13.0, 0.5)))
    strays = ByVehicle(13.0, second.influence, counts, np.array([3.0, -4.0]))
    quantity, near = Quantity("mot.hota", "HOTA"), np.eye(9)
    alone = _of_sides("a", quantity, [first, second], near)
    beside = [_of_sides("a", quantity, sides, near) for sides in ([first, strays], [strays, first])]
    assert (alone.a, alone.b, alone.pairs, alone.same) == (10.0, 13.0, 8, False)
    assert [each.effect.difference for each in (alone, *beside)] == [3.0, 3.0, -3.0]
    for each in beside:
        assert each.effect.se**2 == pytest.approx(alone.effect.se**2 + 25.0)
    assert _of_sides("a", quantity, [first, first], near).same
    assert not _of_sides("a", quantity, [second, strays], near).same
