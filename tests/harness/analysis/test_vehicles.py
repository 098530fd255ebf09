"""Each vehicle's part in a run's metric: the metric itself, its derivative, and who drives beside whom."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from harness.analysis import vehicles
from harness.analysis.single import _of_sides
from harness.analysis.why import failures
from harness.scoring.gathered import Evidence, gather
from harness.scoring.metrics.quantity import Quantity
from harness.scoring.metrics.registry import score_metrics
from tests.harness.scoring.scenes import Scene

CARS = 6


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return six_cars(3)


def six_cars(seed: int, apart_m: float = 40.0) -> Evidence:
    """Return what is known of six cars in two lanes, two of them hidden for a time, under a tracker with a stray."""
    rng, step, scene = np.random.default_rng(seed), np.arange(80), Scene(80)
    for car in range(CARS):
        hidden = (car in (2, 5)) & (step >= 40) & (step < 60)
        lon, lat = 2.0 * step + apart_m * (car // 2), 4.0 * (car % 2)
        scene.vehicle(str(car), lon, lat, np.where(hidden, "hidden", "visible"), ~hidden, speed=20.0)
        at = step[(rng.random(80) < 0.9) & ~((car == 5) & (step > 45))]
        off = rng.normal(size=(2, len(at)))
        number = car + 10 * ((at > 50) & (car == 1))
        scene.track(number, lon[at] + off[0], lat + 0.3 * off[1], at, speed=20.0, std=0.5)
    scene.track(99, 2.0 * step[10:30] + 60.0, 12.0, step[10:30], speed=20.0, std=0.5)
    truth, detections, tracks = scene.tables()
    return gather(truth.query("not is_ego").reset_index(drop=True), detections, tracks, 0)


@pytest.mark.parametrize(
    ("of", "table", "name"),
    [
        (vehicles.hota_by_vehicle, "mot", "hota"),
        (vehicles.hidden_cost_by_vehicle, "hidden", "hidden_cost_m"),
        (vehicles.hidden_crps_by_vehicle, "hidden", "hidden_crps_m"),
        (vehicles.same_identity_by_vehicle, "occlusion", "same_id_percent"),
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
    np.testing.assert_allclose(vehicles._hota_influence(truths, tracks, matched, associated), numeric, rtol=1e-5)


def test_a_mean_over_rows_is_taken_apart_by_vehicles():
    found = vehicles.ratio_by_vehicle(np.array([1.0, 3.0, 8.0]), np.array([0, 0, 2]), 4)
    assert found.value == 4.0
    np.testing.assert_allclose(found.influence, [(4.0 - 8.0) / 3.0, 0.0, (8.0 - 4.0) / 3.0, 0.0])
    np.testing.assert_allclose(found.counts, [2.0, 0.0, 1.0, 0.0])


def test_closeness_falls_along_the_road_and_nobody_is_closer_than_to_oneself(evidence):
    near = vehicles.closeness(evidence.rows.truth, CARS)
    np.testing.assert_allclose(np.diagonal(near), 1.0)
    np.testing.assert_allclose(near, near.T)
    # Cars 0 and 1 drive side by side, 2 is 40 m ahead of them.
    assert near[0, 1] == pytest.approx(1.0)
    assert near[0, 2] == pytest.approx(1.0 - 40.0 / vehicles.REACH_M)
    assert np.linalg.eigvalsh(near).min() > -1e-9


def test_what_belongs_to_no_vehicle_widens_the_deviation_of_a_difference_and_who_counts_nowhere_is_left_out():
    counts = np.append(np.ones(8), 0.0)
    away = np.append(np.tile([0.5, -0.5], 4), 0.0)
    first, second = (
        vehicles.ByVehicle(value, part * away, counts, np.zeros(0)) for value, part in ((10.0, 1.0), (13.0, 0.5))
    )
    strays = vehicles.ByVehicle(13.0, second.influence, counts, np.array([3.0, -4.0]))
    quantity, near = Quantity("mot.hota", "HOTA"), np.eye(9)
    alone = _of_sides("a", quantity, [first, second], near)
    beside = [_of_sides("a", quantity, sides, near) for sides in ([first, strays], [strays, first])]
    assert (alone.a, alone.b, alone.pairs, alone.same) == (10.0, 13.0, 8, False)
    assert [each.effect.difference for each in (alone, *beside)] == [3.0, 3.0, -3.0]
    for each in beside:
        assert each.effect.se**2 == pytest.approx(alone.effect.se**2 + 25.0)
    assert _of_sides("a", quantity, [first, first], near).same
    assert not _of_sides("a", quantity, [second, strays], near).same


def test_vehicles_out_of_range_are_near_nobody_and_half_of_a_common_time_counts_by_half(evidence):
    truth = evidence.rows.truth
    code = {vehicle: truth.vehicle[np.flatnonzero(truth.lon_m == 40.0 * vehicle)[0]] for vehicle in (0, 1, 2)}
    gone = replace(truth, in_range=(truth.vehicle != code[0]) | (truth.step < 20))
    near = vehicles.closeness(gone, CARS + 1)
    # 20 of 80 steps beside each other: 20 / sqrt(20 * 80).
    assert near[code[0], truth.vehicle[np.flatnonzero(truth.lat_m == 4.0)[0]]] == pytest.approx(0.5)
    assert near[CARS].tolist() == [0.0] * CARS + [1.0]


def test_in_the_plane_closeness_falls_with_the_square_of_what_is_left_in_any_direction(evidence):
    truth = evidence.rows.truth
    kept = np.flatnonzero(np.isin(truth.vehicle, [0, 1, 2]) & (truth.step == 0))
    first, second, third = kept[np.argsort(truth.vehicle[kept])]
    direction = np.zeros(len(truth))
    direction[-1] = 0.1
    away_m = np.hypot(truth.lon_m[first] - truth.lon_m[third], truth.lat_m[first] - truth.lat_m[third])
    near = vehicles.closeness(replace(truth, direction_rad=direction), CARS)
    assert near[0, 2] == pytest.approx((1.0 - away_m / vehicles.REACH_M) ** 2)
    across_m = np.hypot(truth.lon_m[first] - truth.lon_m[second], truth.lat_m[first] - truth.lat_m[second])
    assert across_m > 0.0
    assert near[0, 1] == pytest.approx((1.0 - across_m / vehicles.REACH_M) ** 2)
    far = replace(truth, lon_m=truth.lon_m + 900.0 * (truth.vehicle == 0), direction_rad=direction)
    assert vehicles.closeness(far, CARS)[0, 1:].max() == 0.0


def test_a_mean_over_no_rows_is_none_and_a_scale_is_of_the_mean_and_its_parts():
    nothing = vehicles.ratio_by_vehicle(np.zeros(0), np.zeros(0, dtype=np.int64), 2)
    assert np.isnan(nothing.value)
    assert [part.tolist() for part in (nothing.influence, nothing.counts, nothing.others)] == [[0.0] * 2, [0.0] * 2, []]
    percent = vehicles.ratio_by_vehicle(np.array([1.0, 0.0, 1.0]), np.array([0, 0, 1]), 2, 100.0)
    assert percent.value == pytest.approx(200 / 3)
    np.testing.assert_allclose(percent.influence, [(100.0 - 2 * 200 / 3) / 3, (100.0 - 200 / 3) / 3])
    assert percent.others.tolist() == []


def test_cars_whose_tracks_were_changed_or_lost_weigh_most_in_hota(evidence):
    weights = np.abs(vehicles.hota_by_vehicle(evidence, CARS).influence)
    disturbed = sorted({int(each.vehicle_id) for each in failures(evidence)})
    others = sorted(set(range(CARS)) - set(disturbed))
    assert weights[disturbed].max() > weights[others].max()


def test_a_run_without_tracks_has_no_part_of_hota_and_one_without_vehicles_no_hota(evidence):
    nobody = np.zeros((3, 2))
    assert vehicles._hota_influence(np.ones(3), np.zeros(3), nobody, nobody).tolist() == [0.0] * 3
    alone = np.array([[2.0], [2.0]])
    assert vehicles._hota_influence(np.full(2, 1.0), np.full(2, 1.0), alone, alone).tolist() == [0.0, 0.0]


def in_plain_view(reported) -> Evidence:
    """Return what is known of cars in plain view for 4 s, each with a track from the end on for so many steps."""
    scene = Scene(40)
    for number, steps in enumerate(reported):
        lon = -54.0 + 9.0 * (number % 12)
        scene.vehicle(f"car{number}", lon=lon, lat=8.0 * (number // 12))
        scene.track(number, lon, 8.0 * (number // 12), at=np.arange(40 - steps, 40))
    return gather(*scene.tables(), 0)


REPORTED = [34, 3, 20, 30, 9, 35, 31, 29, 28, 33, 27, 32, 26, 25, 24, 23, 22, 21, 19, 18]


def test_recall_in_plain_view_is_the_metric_and_a_mean_over_vehicles_parts():
    evidence = in_plain_view(REPORTED)
    found = vehicles.plain_view_by_vehicle(evidence, 20)
    assert found.value == pytest.approx(score_metrics(evidence)["in_plain_view"]["recall"])
    assert found.value == pytest.approx(100.0 * np.mean(REPORTED) / 35.0)
    np.testing.assert_allclose(found.influence, (100.0 * np.array(REPORTED) / 35.0 - found.value) / 20.0)


def test_the_influence_on_the_worst_tenth_is_its_derivative_along_a_vehicles_weight():
    evidence = in_plain_view(REPORTED)
    found = vehicles.worst_tenth_by_vehicle(evidence, 20)
    recall = 100.0 * np.array(REPORTED) / 35.0
    assert found.value == pytest.approx(score_metrics(evidence)["in_plain_view"]["worst_tenth"])
    assert found.value == pytest.approx(np.sort(recall)[:2].mean())

    def worst_tenth(weight: np.ndarray) -> float:
        """The mean over the worst tenth of the weight, of which the last vehicle may be in with a part of its own."""
        order = np.argsort(recall)
        within = np.clip(0.1 * weight.sum() - np.append(0.0, np.cumsum(weight[order])[:-1]), 0.0, weight[order])
        return float(recall[order] @ within / within.sum())

    step = 1e-6
    # Less weight, so that the tenth still ends within the second vehicle.
    numeric = [(worst_tenth(np.ones(20)) - worst_tenth(np.ones(20) - step * unit)) / step for unit in np.eye(20)]
    # Outside the tenth, the end of the tenth moves within the worst two; inside, beyond them by nothing that counts.
    outside = np.argsort(recall)[2:]
    np.testing.assert_allclose(found.influence[outside], np.array(numeric)[outside], rtol=1e-4)
    assert found.influence.sum() == pytest.approx(0.0)
    worst, second = np.argsort(recall)[:2]
    assert found.influence[worst] - found.influence[second] == pytest.approx((recall[worst] - recall[second]) / 2.0)


@pytest.mark.parametrize("number", [30, 100])
def test_intervals_of_the_worst_tenth_cover_what_they_say(monkeypatch, number):
    rng, covered = np.random.default_rng(number), []
    for _ in range(500):
        counted, chance = rng.integers(10, 200, number), rng.beta(20.0, 1.0, number)
        sides = []
        for followed in rng.binomial(counted, chance, (2, number)):
            part = SimpleNamespace(counted=counted, followed=followed, counted_s=0.1 * counted)
            monkeypatch.setattr(vehicles, "measure_plain_view", lambda _, part=part: part)
            sides.append(vehicles.worst_tenth_by_vehicle(part, number))
        low, high = _of_sides("a", Quantity("mot.hota", "HOTA"), sides, np.eye(number)).effect.ci95
        covered.append(low <= 0.0 <= high)
    assert 0.92 <= np.mean(covered) <= 0.99


def test_without_a_vehicle_in_plain_view_there_is_no_recall(evidence):
    for each in (vehicles.plain_view_by_vehicle(evidence, CARS), vehicles.worst_tenth_by_vehicle(evidence, CARS)):
        assert np.isnan(each.value)
        assert not each.influence.any()
