"""What is learned of false objects and vehicles, against populations whose figures are known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mmpf.joint.false_objects import FALSE_KINDS, FEWEST_HITS, PRIOR_APPEAR_S, FalseObjects
from mmpf.joint.kinds import LEVELS, MOVING, SHAPE, STANDING, VEHICLE
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.options.joint import JointFalseObjects, JointVehicles
from mmpf.scan import SensorModel

OPTIONS, VEHICLES, SENSOR = JointFalseObjects(), JointVehicles(), SensorModel()
FOREVER_S = 1e12
NOTHING_ENDED = np.zeros((1, FALSE_KINDS, LEVELS))
counts = arrays(np.float64, (FALSE_KINDS, LEVELS), elements=st.floats(0.0, 50.0))


def surely(kind: IntArray, level: IntArray) -> FloatArray:
    kinds = np.zeros((len(kind), *SHAPE))
    kinds[np.arange(len(kind)), kind, 0, level] = 1.0
    return kinds


def ended_as(kind: int, level: int) -> FloatArray:
    ended = NOTHING_ENDED.copy()
    ended[0, kind - STANDING, level] = 1.0
    return ended


def assert_as_in_the_settings(learned: FalseObjects) -> None:
    prior = np.array(OPTIONS.detectability) / sum(OPTIONS.detectability)
    vehicles = np.array(VEHICLES.detectability) / sum(VEHICLES.detectability)
    assert learned.births_per_s(SENSOR, OPTIONS) == pytest.approx(OPTIONS.birth_share * SENSOR.clutter_per_scan)
    assert learned.kind_shares(OPTIONS) == pytest.approx([OPTIONS.standing_share, 1.0 - OPTIONS.standing_share])
    assert learned.profiles(OPTIONS) == pytest.approx(np.stack([prior, prior]))
    assert learned.mean_life_s(OPTIONS) == pytest.approx([OPTIONS.life_s] * 2)
    assert learned.vehicle_profile(VEHICLES) == pytest.approx(vehicles)


def test_before_anything_was_found_the_settings_and_the_data_sheet_hold() -> None:
    assert_as_in_the_settings(FalseObjects.none())


def test_long_after_the_last_one_all_but_their_number_is_forgotten() -> None:
    found = FalseObjects.none().with_removed(surely(np.array([STANDING]), np.array([0])), NOTHING_ENDED, np.ones(1))
    later = found.after(1e4, OPTIONS.memory_s)
    assert later.births_per_s(SENSOR, OPTIONS) < 0.1 * OPTIONS.birth_share * SENSOR.clutter_per_scan
    assert_as_in_the_settings(replace(later, watched_s=0.0))


@given(st.floats(0.01, 50.0), st.floats(0.01, 50.0))
def test_time_forgets_alike_in_one_step_and_in_two(first_s: float, second_s: float) -> None:
    found = FalseObjects.none().with_removed(surely(np.array([MOVING]), np.array([3])), NOTHING_ENDED, np.ones(1))
    at_once, in_two = found.after(first_s + second_s, 60.0), found.after(first_s, 60.0).after(second_s, 60.0)
    assert in_two.counted == pytest.approx(at_once.counted)
    assert in_two.since_start_s == pytest.approx(at_once.since_start_s)
    assert at_once.counted.sum() == pytest.approx(np.exp(-(first_s + second_s) / 60.0))


@given(counts, arrays(np.float64, LEVELS, elements=st.floats(0.0, 50.0)), st.floats(0.0, 1e3))
def test_shares_are_shares_and_rates_and_lives_are_positive(
    counted: FloatArray, vehicles: FloatArray, watched_s: float
) -> None:
    learned = replace(FalseObjects.none(), counted=counted, vehicles=vehicles, watched_s=watched_s)
    assert learned.profiles(OPTIONS).sum(axis=1) == pytest.approx(np.ones(FALSE_KINDS))
    assert learned.kind_shares(OPTIONS).sum() == pytest.approx(1.0)
    assert learned.vehicle_profile(VEHICLES).sum() == pytest.approx(1.0)
    assert learned.births_per_s(SENSOR, OPTIONS) > 0.0
    assert (learned.mean_life_s(OPTIONS) > 0.0).all()


@pytest.mark.parametrize("kind", [STANDING, MOVING])
def test_one_that_was_removed_counts_once_whether_it_had_ended_or_not(kind: int) -> None:
    nobody = np.zeros((1, *SHAPE))
    gone = FalseObjects.none().with_removed(nobody, ended_as(kind, 2), np.array([1.7]))
    still = FalseObjects.none().with_removed(surely(np.array([kind]), np.array([2])), NOTHING_ENDED, np.array([1.7]))
    for learned in (gone, still):
        assert learned.counted[kind - STANDING, 2] == pytest.approx(1.0)
        assert learned.counted.sum() == pytest.approx(1.0)
        assert learned.lived_s.sum() == pytest.approx(1.7)
    assert (gone.ended.sum(), still.ended.sum()) == pytest.approx((1.0, 0.0))


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_one_that_may_have_been_a_vehicle_counts_as_far_as_it_was_none(share: float, has_ended: float) -> None:
    source = share * surely(np.array([VEHICLE]), np.array([6])) * (1.0 - has_ended)
    source += (1.0 - share) * surely(np.array([STANDING]), np.array([2])) * (1.0 - has_ended)
    ended = (1.0 - share) * has_ended * ended_as(STANDING, 2)
    learned = FalseObjects.none().with_removed(source, ended, np.array([2.0]))
    assert learned.counted.sum() == pytest.approx(1.0 - share)
    assert learned.lived_s.sum() == pytest.approx(2.0 * (1.0 - share))


def test_vehicles_count_while_they_are_there_and_once_more_when_they_are_gone_not_twice() -> None:
    kinds = surely(np.array([VEHICLE, VEHICLE]), np.array([1, 5]))
    hits, nobody, first = np.full(2, FEWEST_HITS), np.zeros(2, dtype=np.bool_), np.array([True, False])
    in_view, stood = np.array([1.0, 0.0]), np.array([0.5, 1.0])
    learned = FalseObjects.none()
    for removed in (nobody, nobody, first):
        learned = learned.with_vehicles(kinds, hits, in_view, stood, removed)
    learned = learned.with_vehicles(kinds[1:], hits[1:], in_view[1:], stood[1:], nobody[1:])
    number = (learned.vehicles + learned.present).sum(axis=0)
    assert (learned.in_view.sum(), learned.stood.sum()) == pytest.approx((1.0, 1.5))
    assert number == pytest.approx([0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0])


def test_a_vehicle_that_was_hardly_looked_at_says_nothing_of_vehicles() -> None:
    few = FalseObjects.none().with_vehicles(
        surely(np.array([VEHICLE]), np.array([0])),
        np.array([FEWEST_HITS - 1]),
        np.ones(1),
        np.ones(1),
        np.zeros(1, dtype=np.bool_),
    )
    assert few.vehicle_profile(VEHICLES) == pytest.approx(FalseObjects.none().vehicle_profile(VEHICLES))


def test_counts_recover_the_population_that_they_are_of() -> None:
    """Two a second for 400 s, six of ten standing for 3 s on average and the others moving for 1 s, at three levels.

    Bounds: four standard errors of so many, and what the prior's few objects may add.
    """
    rng = np.random.default_rng(0)
    duration_s, dt_s, rate, lives = 400.0, 0.5, 2.0, np.array([3.0, 1.0])
    profiles = np.zeros((FALSE_KINDS, LEVELS))
    profiles[0, [0, 2]], profiles[1, [2, 4]] = (0.7, 0.3), (0.5, 0.5)
    learned = FalseObjects.none()
    for _ in range(int(duration_s / dt_s)):
        learned = learned.after(dt_s, FOREVER_S)
        for _ in range(rng.poisson(rate * dt_s)):
            which = int(rng.random() >= 0.6)
            ended = ended_as(STANDING + which, int(rng.choice(LEVELS, p=profiles[which])))
            learned = learned.with_removed(np.zeros((1, *SHAPE)), ended, rng.exponential(lives[[which]]))
    assert learned.births_per_s(SENSOR, OPTIONS) == pytest.approx(rate, abs=0.3)
    assert learned.kind_shares(OPTIONS) == pytest.approx([0.6, 0.4], abs=0.08)
    assert learned.mean_life_s(OPTIONS) == pytest.approx(lives, rel=0.25)
    assert learned.profiles(OPTIONS) == pytest.approx(profiles, abs=0.13)


def test_what_was_learned_of_those_that_stand_is_where_those_that_move_begin() -> None:
    learned = FalseObjects.none()
    for _ in range(1000):
        learned = learned.with_removed(np.zeros((1, *SHAPE)), ended_as(STANDING, 1), np.ones(1))
    assert learned.profiles(OPTIONS)[:, 1] == pytest.approx([1.0, 1.0], abs=0.01)
    for _ in range(1000):
        learned = learned.with_removed(np.zeros((1, *SHAPE)), ended_as(MOVING, 5), np.ones(1))
    assert learned.profiles(OPTIONS)[0, 1] == pytest.approx(1.0, abs=0.01)
    assert learned.profiles(OPTIONS)[1, 5] == pytest.approx(1.0, abs=0.01)


def test_what_is_forgotten_does_not_bias_the_rate() -> None:
    learned, rng = FalseObjects.none(), np.random.default_rng(1)
    rates = []
    for step in range(4000):
        learned = learned.after(0.5, 60.0)
        for _ in range(rng.poisson(1.0)):
            learned = learned.with_removed(np.zeros((1, *SHAPE)), ended_as(STANDING, 2), np.ones(1))
        if step > 1000:
            rates.append(learned.births_per_s(SENSOR, OPTIONS))
    assert np.mean(rates) == pytest.approx(2.0, rel=0.1)


def test_rates_of_vehicles_that_nobody_has_seen_are_only_raised_by_what_is_counted() -> None:
    nobody = replace(FalseObjects.none(), watched_s=1e4)
    assert nobody.vehicles_in_view_per_s(0.05) == 0.05
    assert nobody.standing_share(0.1, VEHICLES) == pytest.approx(0.1)
    many = replace(nobody, watched_s=10.0, in_view=np.array([50.0, 50.0]))
    expected = (PRIOR_APPEAR_S * 0.05 + 100.0) / (PRIOR_APPEAR_S + 10.0)
    assert many.vehicles_in_view_per_s(0.05) == pytest.approx(expected)
    parked = replace(nobody, vehicles=np.full((3, LEVELS), 10.0), stood=np.array([150.0, 0.0]))
    prior = VEHICLES.prior_count
    assert parked.standing_share(0.1, VEHICLES) == pytest.approx((0.1 * prior + 150.0) / (prior + 210.0))
