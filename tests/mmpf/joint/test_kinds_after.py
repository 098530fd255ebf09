"""What a scan makes of existence and kind, against all cases enumerated, and in scenes of one or two components."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.joint.false_objects import FalseObjects
from mmpf.joint.kinds import (
    DETECTABILITY,
    FALSE,
    KINDS,
    LEVELS,
    SHADING,
    SHAPE,
    VEHICLE,
    Sightings,
    normalised,
    vehicle_share,
)
from mmpf.joint.kinds_after import OVERLAP_PER_S, ended_meanwhile, kinds_after
from mmpf.joint.mistaken import mistaken_after
from mmpf.joint.newborn import Appearances, kinds_at_birth
from mmpf.joint.sources import Sources, sources_of
from mmpf.joint.speeds import STANDING_STD_MPS, log_speed_likelihoods
from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import FilterOptions
from mmpf.scan import SensorModel
from tests.mmpf.scenes import belief_of, lane_centre, spot
from tests.mmpf.test_update_rules import situation_with

OPTIONS = FilterOptions()
MOST_LOG_ODDS = OPTIONS.joint.kinds.largest_log_odds
LANE = lane_centre(2)
IN_VIEW = 0.95
CLEAR = 100.0
DT_S = 0.1
NOTHING = FalseObjects.none()


def options_with(**groups: dict[str, object]) -> FilterOptions:
    return FilterOptions.model_validate({"joint": groups})


UNBOUNDED = options_with(existence={"largest": 1.0}, kinds={"largest_log_odds": 30.0})


def source(speed_mps: float = 20.0, **columns: FloatArray) -> Mixture:
    return belief_of([spot(30.0, LANE, speed_mps)], **columns)


def seen_as(claimed: float, in_shadow: float = IN_VIEW, run: float = 0.0, count: int = 1) -> Sightings:
    return Sightings(*(np.full(count, each) for each in (in_shadow, IN_VIEW, 1.0, claimed, claimed > 0.0, run)))


def scanned(
    mixture: Mixture, sightings: Sightings, options: FilterOptions = OPTIONS, dt_s: float = DT_S, was_seen: bool = True
) -> Mixture:
    """Return the belief after a scan; the particles stay where they are."""
    situation = replace(situation_with([]), dt_s=dt_s)
    before = mixture.components
    alive, ended = ended_meanwhile(before, NOTHING, dt_s, options.joint)
    components = before.after_scan(np.full(len(mixture), was_seen), dt_s)
    moments = component_moments(mixture)
    after = kinds_after(components, before, alive, ended, moments, sightings, NOTHING, situation, options)
    return replace(mixture, components=after)


def newborn(options: FilterOptions = OPTIONS, in_view: float = 0.0) -> FloatArray:
    place = Appearances(np.array([in_view]), np.array([in_view]), np.ones(1), DT_S)
    return kinds_at_birth(place, NOTHING, SensorModel(), options.joint)


def log_odds(sources: Sources) -> float:
    share = float(sources.vehicle_share[0])
    return float(np.log(share / (1.0 - share)))


scans_of_one = st.lists(
    st.tuples(st.sampled_from([0.0, 0.5, 3.0, 40.0]), st.floats(0.02, 0.95), st.floats(0.0, 0.9), st.floats(0.05, 0.5)),
    min_size=1,
    max_size=5,
)


@given(scans_of_one, st.floats(0.05, 0.95))
@settings(max_examples=25, deadline=None)
def test_existence_and_kind_are_those_of_all_cases_enumerated(
    scans: list[tuple[float, float, float, float]], existence: float
) -> None:
    """The cases: nobody ever, a false object that has ended, and each source that is there."""
    joint = UNBOUNDED.joint
    prior = newborn()
    nobody, ended, alive = 1.0 - existence, np.zeros((KINDS, LEVELS)), existence * prior[0]
    usual = np.array(joint.vehicles.shading) / sum(joint.vehicles.shading)
    found = source(kinds=prior, existence=np.array([existence]))
    for claimed, in_shadow, run, dt_s in scans:
        there, survival = np.zeros(SHAPE), np.exp(-joint.existence.death_rate_per_s * dt_s)
        ends = 1.0 - np.exp(-dt_s / joint.false_objects.life_s)
        forgotten = 1.0 - np.exp(-dt_s / joint.vehicles.shading_s)
        nobody += (1.0 - survival) * alive[VEHICLE].sum()
        for kind, shading, level in product(range(KINDS), range(len(SHADING)), range(LEVELS)):
            weight = alive[kind, shading, level]
            if kind == VEHICLE:
                weight += forgotten * (usual[shading] * alive[VEHICLE, :, level].sum() - weight)
                weight *= survival
            else:
                ended[kind, level] += ends * weight
                weight *= 1.0 - ends
            detected = (1.0 - run) * IN_VIEW * (in_shadow / IN_VIEW) ** SHADING[shading] * DETECTABILITY[level]
            there[kind, shading, level] = weight * (1.0 - detected + detected * claimed)
        total = nobody + ended.sum() + there.sum()
        nobody, ended, alive = nobody / total, ended / total, there / total
        found = scanned(found, seen_as(claimed, in_shadow, run), UNBOUNDED, dt_s, was_seen=False)
        assert found.components.existence == pytest.approx([alive.sum()], rel=1e-6)
        assert found.components.kinds[0] == pytest.approx(alive / alive.sum(), abs=1e-6)
        assert found.components.ended[0] == pytest.approx(ended[FALSE], abs=1e-6)


@given(scans_of_one)
@settings(max_examples=25, deadline=None)
def test_the_posterior_sums_to_one_and_is_never_certain(scans: list[tuple[float, float, float, float]]) -> None:
    found = source(kinds=newborn())
    for claimed, in_shadow, run, dt_s in scans:
        found = scanned(found, seen_as(claimed, in_shadow, run), dt_s=dt_s)
        assert found.components.kinds.sum() == pytest.approx(1.0)
        assert abs(log_odds(found.components)) <= MOST_LOG_ODDS + 1e-6
        assert 0.0 <= found.components.existence[0] <= OPTIONS.joint.existence.largest


def test_a_speed_counts_as_it_is_at_present_and_is_not_summed_up() -> None:
    """Seen in a run of misses, so that nothing but the speed says anything."""
    before = source(3.0, kinds=newborn())
    situation, moments = situation_with([]), component_moments(before)
    alive, _ = ended_meanwhile(before.components, NOTHING, DT_S, UNBOUNDED.joint)
    range_m, speeds = OPTIONS.birth.local_range_m, OPTIONS.joint.speeds
    stood = np.array([-0.5 * (3.0 / STANDING_STD_MPS) ** 2])
    likelihood = log_speed_likelihoods(moments, situation.traffic, range_m, speeds.stopped_on_road, stood)
    expected = normalised(alive * np.exp(likelihood)[:, :, None, None])
    once = scanned(before, seen_as(0.0, run=1.0), UNBOUNDED)
    assert once.components.kinds == pytest.approx(expected, abs=1e-9)
    again, _ = ended_meanwhile(once.components, NOTHING, DT_S, UNBOUNDED.joint)
    twice = scanned(once, seen_as(0.0, run=1.0), UNBOUNDED)
    assert twice.components.kinds == pytest.approx(normalised(again), abs=1e-9)


def test_the_speed_of_one_that_is_not_seen_says_nothing() -> None:
    before = source(0.0, kinds=newborn())
    alive, _ = ended_meanwhile(before.components, NOTHING, DT_S, OPTIONS.joint)
    after = scanned(before, seen_as(0.0, run=1.0), was_seen=False)
    assert after.components.kinds == pytest.approx(normalised(alive))


@pytest.mark.parametrize("dt_s", [0.1, 0.3])
def test_of_two_seen_sources_in_one_place_the_one_that_is_less_of_a_vehicle_loses(dt_s: float) -> None:
    kinds = np.concatenate([newborn(), newborn(in_view=1.0)])
    both = belief_of([spot(30.0, LANE), spot(31.0, LANE)], kinds=kinds)
    apart = belief_of([spot(30.0, LANE), spot(60.0, LANE)], kinds=kinds)
    found, free = (scanned(each, seen_as(CLEAR, count=2), UNBOUNDED, dt_s).components.kinds for each in (both, apart))
    odds, without = (np.log(vehicle_share(each) / (1.0 - vehicle_share(each))) for each in (found, free))
    assert odds - without == pytest.approx([0.0, -OVERLAP_PER_S * dt_s], abs=1e-6)


@pytest.mark.parametrize("beside_m", [0.0, 3.66])
def test_of_one_that_drives_through_another_each_loses_what_the_other_says(beside_m: float) -> None:
    """Half a way past each other in one scan; a car in the next lane says nothing."""
    kinds = np.concatenate([newborn(), newborn(in_view=1.0)])
    pair = belief_of([spot(30.0, LANE, 15.0), spot(31.0, LANE + beside_m, 35.0)], kinds=kinds)
    alone = belief_of([spot(30.0, LANE, 15.0), spot(60.0, LANE, 35.0)], kinds=kinds)
    dt_s = float(pair.components.length_m[0]) / (35.0 - 15.0)
    found, free = (scanned(each, seen_as(CLEAR, count=2), UNBOUNDED, dt_s).components.kinds for each in (pair, alone))
    odds, without = (np.log(vehicle_share(each) / (1.0 - vehicle_share(each))) for each in (found, free))
    other = pair.components.existence[::-1] * vehicle_share(kinds)[::-1]
    expected = 0.5 * np.log(1.0 - other) if beside_m == 0.0 else np.zeros(2)
    assert odds - without == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("unseen_s", [0.0, 3.0])
def test_what_lies_on_the_ego_becomes_less_of_a_vehicle_seen_or_hidden(unseen_s: float) -> None:
    kinds, dt_s = newborn(), 0.2
    on_ego, away = (belief_of([spot(lon_m, LANE, 20.0)], kinds=kinds, unseen_s=[unseen_s]) for lon_m in (0.0, -30.0))
    found, free = (scanned(each, seen_as(CLEAR), UNBOUNDED, dt_s).components.kinds for each in (on_ego, away))
    odds, without = (np.log(vehicle_share(each) / (1.0 - vehicle_share(each))) for each in (found, free))
    assert odds - without == pytest.approx([-OVERLAP_PER_S * dt_s], abs=1e-6)


def test_where_the_question_is_not_asked_vehicles_stay_vehicles() -> None:
    options = options_with(kinds={"weighed": False})
    found = source(0.0, kinds=newborn(options))
    for hit in [True, False, False, True]:
        found = scanned(found, seen_as(CLEAR * hit), options)
        assert vehicle_share(found.components.kinds) == pytest.approx([1.0])


@pytest.mark.parametrize("in_shadow", [0.1, 0.9])
@pytest.mark.parametrize("detected", [True, False])
def test_the_odds_that_a_false_object_is_followed_are_summed_over_cases(detected: bool, in_shadow: float) -> None:
    before, prior = sources_of(source(mistaken=[0.2], away_std=[[4.0, 1.0, 3.0]])), OPTIONS.joint.false_objects
    probability = seen_as(0.0, in_shadow).detection_probabilities()[0]
    by_vehicle = (before.kinds[0, VEHICLE] * probability).sum()
    shares = np.outer(prior.shading, prior.detectability) / np.sum(prior.shading) / np.sum(prior.detectability)
    now = replace(before, unseen_s=np.array([0.0 if detected else 0.3]))
    after = mistaken_after(now, before, seen_as(0.0, in_shadow), NOTHING, prior, np.zeros(1), DT_S)
    by_false = np.exp(-DT_S / prior.life_s) * (shares * probability).sum()
    ratio = by_false / by_vehicle if detected else (1.0 - by_false) / (1.0 - by_vehicle)
    assert after.mistaken / (1.0 - after.mistaken) == pytest.approx(0.25 * ratio)
    assert after.away_std == pytest.approx(np.array([[4.0 + 3.0 * DT_S, 1.0, 3.0]]))
    fast = replace(now, away_std=np.array([[19.0, 1.0, 30.0]]))
    fast_after = mistaken_after(fast, before, seen_as(0.0, in_shadow), NOTHING, prior, np.zeros(1), DT_S)
    assert fast_after.away_std[0, 0] == 20.0
    across = mistaken_after(now, before, seen_as(0.0, in_shadow), NOTHING, prior, np.array([0.5 * np.pi]), DT_S)
    assert across.away_std == pytest.approx(np.array([[4.0, 1.0 + 3.0 * DT_S, 3.0]]))
