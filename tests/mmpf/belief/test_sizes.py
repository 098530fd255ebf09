"""Measured sizes: what they say of a vehicle, what a tracker makes of them, and what it does without."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmpf.belief.mixture import Components
from mmpf.belief.sizes import sizes_of, with_measured_sizes
from mmpf.options.filter import MEAN_CAR
from mmpf.scan import BodySizes, InvalidScanError, Scan, check_scan
from mmpf.tracks import HIDDEN, Tracks
from tests.mmpf.scenes import ego_at, lane_centre, scan_of
from tests.mmpf.test_tracker import tracker_with

CAR, TRUCK = (4.7, 1.9), (18.0, 2.5)
SHARE = 0.1


def sized(scan: Scan, true_sizes: list[tuple[float, float]], rng: np.random.Generator | None = None) -> Scan:
    """Return the scan with measured sizes: exact ones, or noisy ones."""
    true = np.array(true_sizes, dtype=np.float64).reshape(-1, 2)
    noise = np.zeros_like(true) if rng is None else rng.standard_normal(true.shape)
    length, width = (true * (1.0 + SHARE * noise)).T
    sizes = BodySizes(length, width, SHARE * true[:, 0], SHARE * true[:, 1])
    return replace(scan, detections=replace(scan.detections, sizes=sizes))


def two_components() -> Components:
    return Components.newborn(np.array([4, 9]), np.array([0.5, 0.5]))


def test_components_have_no_column_of_a_misspelt_name() -> None:
    with pytest.raises(TypeError, match="lenght_m"):
        two_components().having(lenght_m=np.ones(2))


measurements = st.lists(st.tuples(st.floats(2.0, 20.0), st.floats(0.1, 5.0)), min_size=1, max_size=8)


@given(measurements)
def test_sizes_average_by_their_precisions(measured: list[tuple[float, float]]) -> None:
    components = two_components()
    for length_m, std_m in measured:
        once = BodySizes(*(np.array([value]) for value in (length_m, 1.8, std_m, 0.2)))
        components = with_measured_sizes(components, np.array([1]), once)
    values, stds = np.array([(MEAN_CAR.length_m, MEAN_CAR.std_length_m), *measured]).T
    precision = 1.0 / stds**2
    assert components.length_m[1] == pytest.approx(np.average(values, weights=precision))
    assert components.std_length_m[1] == pytest.approx(precision.sum() ** -0.5)
    assert (components.length_m[0], components.std_length_m[0]) == (MEAN_CAR.length_m, MEAN_CAR.std_length_m)


def test_a_measured_size_leaves_the_components_it_came_from_as_they_were() -> None:
    before = two_components()
    with_measured_sizes(before, np.array([0]), BodySizes(*(np.array([value]) for value in (18.0, 2.5, 0.5, 0.1))))
    assert before.length_m.tolist() == [MEAN_CAR.length_m] * 2
    assert sizes_of(before, np.array([1])).std_width_m.tolist() == [MEAN_CAR.std_width_m]


def test_a_tracker_that_sees_a_truck_often_knows_its_size_as_well_as_the_mean_of_all_measurements() -> None:
    tracker, rng, lengths = tracker_with(), np.random.default_rng(3), []
    for step in range(40):
        scan = sized(scan_of(0.1 * step, [(20.0 + 2.0 * step, lane_centre(3))], ego_at(2.0 * step)), [TRUCK], rng)
        lengths.append(scan.detections.sizes.length_m[0])
        tracker.step(scan)
    prior, one = MEAN_CAR.std_length_m**-2, (SHARE * TRUCK[0]) ** -2
    components = tracker.mixture.components
    expected = (prior * MEAN_CAR.length_m + one * np.sum(lengths)) / (prior + 40 * one)
    assert components.length_m == pytest.approx([expected])
    assert components.std_length_m == pytest.approx([(prior + 40 * one) ** -0.5])
    assert components.length_m[0] == pytest.approx(TRUCK[0], abs=5 * components.std_length_m[0])


@pytest.mark.parametrize("update", ["joint", "max_likelihood"])
def test_vehicles_whose_sizes_are_not_measured_are_mean_cars(update: str) -> None:
    tracker = tracker_with(update)
    for step in range(10):
        tracker.step(scan_of(0.1 * step, [(20.0 + 2.0 * step, lane_centre(3))], ego_at(2.0 * step)))
    components = tracker.mixture.components
    assert components.length_m.tolist() == [MEAN_CAR.length_m]
    assert components.width_m.tolist() == [MEAN_CAR.width_m]


@pytest.mark.parametrize("update", ["joint", "max_likelihood"])
def test_a_scan_without_detections_is_no_trouble_to_a_sensor_that_measures_sizes(update: str) -> None:
    tracker = tracker_with(update)
    for step in range(12):
        seen = [(20.0, lane_centre(3))] if step % 4 else []
        tracker.step(sized(scan_of(0.1 * step, seen), [CAR] * len(seen)))
    assert len(tracker.mixture) == 1


def car_that_drives_into_the_shadow_of_a_truck(measures_sizes: bool) -> tuple[int, Tracks]:
    """Return the car's track at 17 m, where the truck begins to hide it, and all tracks 3 s later.

    Seen from the ego the truck spans 11 to 29 m in the next lane. The car passes in the lane beyond. A car in the
    truck's place would hide it from 28 m on only.
    """
    tracker = tracker_with()
    truck = (20.0, lane_centre(3))
    name = -1
    for step in range(61):
        car = (5.0 + 0.4 * step, lane_centre(4))
        seen = [truck, car] if car[0] < 17.0 else [truck]
        moved = [(lon + 2.0 * step, lat) for lon, lat in seen]
        scan = scan_of(0.1 * step, moved, ego_at(2.0 * step))
        tracks = tracker.step(sized(scan, [TRUCK, CAR][: len(seen)]) if measures_sizes else scan)
        if len(seen) > 1:
            name = int(tracks.track_id[np.argmax(tracks.lat_m)])
    return name, tracks


def test_a_car_behind_a_trucks_tail_is_known_to_be_hidden_and_not_lost() -> None:
    name, tracks = car_that_drives_into_the_shadow_of_a_truck(measures_sizes=True)
    assert tracks.state[tracks.track_id == name].tolist() == [HIDDEN]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("length_m", [np.nan, 4.7]),
        ("width_m", [1.9, np.inf]),
        ("length_m", [-4.7, 4.7]),
        ("width_m", [0.0, 1.9]),
        ("std_length_m", [0.0, 0.5]),
        ("std_width_m", [np.nan, 0.2]),
        ("length_m", [4.7]),
        ("std_width_m", [[0.2, 0.2]]),
    ],
)
def test_sizes_that_no_vehicle_has_are_refused_by_name(name: str, value: list[float]) -> None:
    scan = sized(scan_of(0.0, [(20.0, lane_centre(2)), (30.0, lane_centre(1))]), [CAR, CAR])
    check_scan(scan, None)
    sizes = replace(scan.detections.sizes, **{name: np.array(value)})
    with pytest.raises(InvalidScanError, match=rf"detections\.sizes\.{name}"):
        check_scan(replace(scan, detections=replace(scan.detections, sizes=sizes)), None)
