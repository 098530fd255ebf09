"""The prior of a new source's kind: by where it appears, and by how many false objects there were."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.joint import newborn
from mmpf.joint.false_objects import FalseObjects
from mmpf.joint.kinds import (
    DETECTABILITY,
    FALSE,
    LEVELS,
    MOVING,
    SHAPE,
    STANDING,
    VEHICLE,
    vehicle_share,
)
from mmpf.joint.known import Known
from mmpf.joint.newborn import SLOWEST_PASSING_MPS, Appearances, appearances_at, kinds_at_birth
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.sensor_plane import SensorPlane
from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import FilterOptions
from mmpf.options.joint import JointOptions
from mmpf.scan import SensorModel
from mmpf.visibility.range_profile import Reach
from tests.mmpf.map.scenes import graph_of
from tests.mmpf.scenes import ROAD, belief_of, ego_at, lane_centre, spot
from tests.mmpf.test_update_rules import situation_with

OPTIONS = JointOptions()
IN_VIEW_PER_S = OPTIONS.newborn.in_view_per_s
KINDS = OPTIONS.kinds
SENSOR = SensorModel()
LANE = lane_centre(2)
NOTHING = FalseObjects.none()
shares = st.floats(0.0, 1.0)


def born(
    in_view: float,
    seen_share: float = 1.0,
    learned: FalseObjects = NOTHING,
    options: JointOptions = OPTIONS,
    scan_s: float = 0.1,
) -> FloatArray:
    place = Appearances(np.array([in_view]), np.array([in_view]), np.array([seen_share]), scan_s)
    return kinds_at_birth(place, learned, SENSOR, options)


def share_of(kinds: FloatArray) -> float:
    return float(vehicle_share(kinds)[0])


def counted(number: float, watched_s: float) -> FalseObjects:
    """So many false objects in so long a time, like the prior's in all else."""
    each = np.array([OPTIONS.false_objects.standing_share, 1.0 - OPTIONS.false_objects.standing_share])
    levels = np.outer(number * each, OPTIONS.false_objects.detectability)
    ended = levels.sum(axis=1)
    lived_s = OPTIONS.false_objects.life_s * ended
    return replace(NOTHING, counted=levels, ended=ended, lived_s=lived_s, watched_s=watched_s)


def places_of(
    places: list[tuple[float, float]], mixture: Mixture, since_start_s: float = 1e3, ego_mps: float = 20.0
) -> Appearances:
    situation = replace(situation_with(places), plane=SensorPlane(ego_at(speed_mps=ego_mps), ROAD))
    known = replace(Known.of_data_sheet(SENSOR), false_objects=replace(NOTHING, since_start_s=since_start_s))
    moments = component_moments(mixture)
    return appearances_at(np.arange(len(places)), mixture, moments, known, situation, FilterOptions())


@given(shares, shares, st.floats(0.0, 500.0), st.floats(0.0, 500.0))
def test_priors_sum_to_one_and_leave_both_kinds_possible(
    in_view: float, seen_share: float, number: float, watched_s: float
) -> None:
    kinds = born(in_view, seen_share, counted(number, watched_s))
    assert kinds.shape == (1, *SHAPE)
    assert (kinds >= 0.0).all()
    assert kinds.sum() == pytest.approx(1.0)
    assert newborn.LEAST_PRIOR - 1e-9 <= share_of(kinds) <= 1.0 - newborn.LEAST_PRIOR + 1e-9


@pytest.mark.parametrize(("in_view", "vehicles_per_s"), [(0.0, newborn.OUT_OF_VIEW_PER_S), (1.0, IN_VIEW_PER_S)])
@pytest.mark.parametrize(("number", "watched_s"), [(0.0, 0.0), (10.0, 20.0), (60.0, 30.0)])
def test_vehicles_and_false_objects_compete_by_how_many_of_each_appear(
    in_view: float, vehicles_per_s: float, number: float, watched_s: float
) -> None:
    prior_s = OPTIONS.false_objects.prior_watched_s
    first = OPTIONS.false_objects.birth_share * SENSOR.clutter_per_scan
    false_per_s = (prior_s * first + number) / (prior_s + watched_s)
    expected = np.clip(vehicles_per_s / (vehicles_per_s + false_per_s), newborn.LEAST_PRIOR, 1.0 - newborn.LEAST_PRIOR)
    assert share_of(born(in_view, learned=counted(number, watched_s))) == pytest.approx(expected)


def test_the_first_scans_prior_is_that_of_places_that_nobody_had_been_looking_at() -> None:
    first = kinds_at_birth(Appearances.unwatched(2), NOTHING, SENSOR, OPTIONS)
    assert first == pytest.approx(np.repeat(born(0.0), 2, axis=0))
    assert share_of(first) > KINDS.confirm_above


def test_of_those_that_are_detected_the_well_detectable_are_the_more() -> None:
    """By Bayes' rule: the share of a level times how probably it is detected, for vehicles and for false objects."""
    kinds = born(0.0)[0].sum(axis=1)
    for kind, profile in (
        (VEHICLE, OPTIONS.vehicles.detectability),
        (STANDING, OPTIONS.false_objects.detectability),
        (MOVING, OPTIONS.false_objects.detectability),
    ):
        expected = np.array(profile) * DETECTABILITY
        assert kinds[kind] / kinds[kind].sum() == pytest.approx(expected / expected.sum())
    standing = kinds[STANDING].sum() / kinds[FALSE].sum()
    assert standing == pytest.approx(OPTIONS.false_objects.standing_share)


@pytest.mark.parametrize("scan_s", [0.05, 0.1, 0.2])
def test_it_was_missed_by_all_scans_of_the_time_in_which_it_was_overlooked(scan_s: float) -> None:
    usual, late = (born(each, scan_s=scan_s)[0, VEHICLE].sum(axis=0) for each in (0.0, 1.0))
    missed = usual * (1.0 - np.minimum(DETECTABILITY, 0.99)) ** round(0.4 / scan_s)
    usual, missed, share = usual / usual.sum(), missed / missed.sum(), OPTIONS.newborn.overlooked_share
    assert late / late.sum() == pytest.approx((1.0 - share) * usual + share * missed)


@pytest.mark.parametrize("seen_share", [0.02, 0.3, 1.0])
def test_a_detection_in_a_shadow_tells_by_bayes_rule_that_the_source_is_seen_past_it(seen_share: float) -> None:
    kinds = born(0.0, seen_share)[0].sum(axis=2)
    for kind, usual in (
        (VEHICLE, OPTIONS.vehicles.shading),
        (STANDING, OPTIONS.false_objects.shading),
        (MOVING, OPTIONS.false_objects.shading),
    ):
        expected = np.array([usual[0] * seen_share, usual[1] * seen_share**0.5, usual[2]])
        assert kinds[kind] / kinds[kind].sum() == pytest.approx(expected / expected.sum())


def test_where_the_question_is_not_asked_all_are_vehicles() -> None:
    unasked = OPTIONS.model_copy(update={"kinds": KINDS.model_copy(update={"weighed": False})})
    assert share_of(born(1.0, learned=counted(50.0, 10.0), options=unasked)) == pytest.approx(1.0)


def test_levels_are_those_of_the_settings() -> None:
    assert len(OPTIONS.vehicles.detectability) == len(OPTIONS.false_objects.detectability) == LEVELS


def test_in_plain_view_a_vehicle_would_have_been_known_and_in_a_shadow_or_at_the_ranges_edge_it_would_not() -> None:
    front = belief_of([spot(15.0, LANE)], confirmed=[True])
    found = places_of([(40.0, lane_centre(0)), (40.0, LANE), (-99.0, LANE)], front)
    assert found.in_view == pytest.approx([1.0, 0.0, 0.0])
    assert found.seen_share[[0, 2]] == pytest.approx([1.0, 1.0])
    assert found.seen_share[1] < 0.1


def test_who_has_just_come_out_of_a_shadow_would_not_have_been_known_before() -> None:
    """A car beside the ego's lane hides part of the next lane; along it vehicles come out at the near end."""
    front = belief_of([spot(15.0, lane_centre(3))], confirmed=[True])
    lon = np.arange(12.0, 90.0, 0.5)
    found = places_of([(each, lane_centre(4)) for each in lon], front)
    first_hidden = lon[found.seen_share < 0.05].min()
    in_view = lon[found.in_view == 1.0]
    before, edge_m = in_view[in_view < first_hidden].max(), newborn.SHADOW_EDGE_S * SLOWEST_PASSING_MPS
    assert edge_m <= first_hidden - before <= edge_m + 2.0 * 4.7
    at_edge = found.in_view[(lon >= first_hidden - edge_m) & (lon < first_hidden)]
    assert (at_edge == 0.0).all()


@pytest.mark.parametrize(("turned_rad", "tolerance"), [(0.5, 0.2), (1.0, 0.2), (0.5 * np.pi, 1e-9), (np.pi, 1e-9)])
def test_what_would_have_been_known_does_not_depend_on_how_the_map_is_turned(
    turned_rad: float, tolerance: float
) -> None:
    """A car beside the ego's lane hides part of the next lane; rays at other angles leave a tolerance."""
    lon = np.arange(12.0, 60.0, 2.0)
    cosine, sine = np.cos(turned_rad), np.sin(turned_rad)

    def found(turn: FloatArray, heading_rad: float) -> FloatArray:
        def at(along: float, left: float) -> tuple[float, float]:
            x, y = turn @ (along, left)
            return float(x), float(y)

        lanes = {str(left): [at(-100.0, left), at(100.0, left)] for left in (0.0, 3.5, 7.0)}
        plane = SensorPlane(replace(ego_at(0.0, 0.0), heading_rad=heading_rad), LaneGraphRoad(graph=graph_of(lanes)))
        situation = replace(situation_with([at(each, 7.0) for each in lon]), plane=plane)
        front = belief_of([spot(*at(15.0, 3.5))], confirmed=[True])
        moments = replace(component_moments(front), heading_rad=np.array([heading_rad]))
        known = replace(Known.of_data_sheet(SENSOR), false_objects=replace(NOTHING, since_start_s=1e3))
        return appearances_at(np.arange(len(lon)), front, moments, known, situation, FilterOptions()).in_view

    straight, turned = found(np.eye(2), 0.0), found(np.array([[cosine, -sine], [sine, cosine]]), turned_rad)
    assert straight.min() == 0.0
    assert straight.max() == 1.0
    assert turned == pytest.approx(straight, abs=tolerance)


@pytest.mark.parametrize("known", [True, False])
def test_only_known_vehicles_cast_shadows_that_explain_an_appearance(known: bool) -> None:
    false = np.zeros((1, *SHAPE))
    false[:, STANDING, 0, -1] = 1.0
    columns = {"confirmed": [True], "kinds": false} if known else {"confirmed": [False]}
    assert places_of([(40.0, LANE)], belief_of([spot(15.0, LANE)], **columns)).in_view == pytest.approx([1.0])


def test_towards_the_ranges_edge_vehicles_appear_ever_more_probably() -> None:
    found = places_of([(lon, LANE) for lon in np.linspace(80.0, 99.5, 40)], belief_of([])).in_view
    assert (np.diff(found) <= 0.0).all()
    assert found[[0, -1]] == pytest.approx([1.0, 0.0])


def test_in_the_first_scans_vehicles_in_plain_view_are_still_found() -> None:
    found = [places_of([(40.0, LANE)], belief_of([]), s).in_view[0] for s in (0.0, 0.1, 1.0, 10.0)]
    assert found[0] == 0.0
    assert (np.diff(found) > 0.0).all()
    assert found[-1] == pytest.approx(1.0, abs=0.01)


def test_where_the_sensor_was_found_to_see_little_a_vehicle_may_have_been_overlooked() -> None:
    blind = Reach.of_data_sheet(SENSOR.range_m).after(np.full(1000, 75.0), np.ones(1000), np.zeros(1000), kept=1.0)
    known, nobody = Known(SENSOR, blind, replace(NOTHING, since_start_s=1e3)), belief_of([])
    situation = situation_with([(75.0, LANE)])
    found = appearances_at(np.arange(1), nobody, component_moments(nobody), known, situation, FilterOptions())
    assert found.in_view[0] < 0.2


def test_a_vehicle_that_stands_may_have_come_out_of_a_shadow_at_the_egos_speed() -> None:
    """The farther from the shadow, the more probably only one that stands has just come out of it."""
    front = belief_of([spot(15.0, lane_centre(3))], confirmed=[True])
    found = places_of([(each, lane_centre(4)) for each in np.arange(12.0, 90.0, 0.5)], front)
    ratio = found.standing_ratio(IN_VIEW_PER_S)
    assert (found.in_view_standing <= found.in_view).all()
    assert (ratio >= 1.0).all()
    beyond = (found.in_view == 1.0) & (found.in_view_standing == 0.0)
    assert beyond.any()
    most = newborn.OUT_OF_VIEW_PER_S / IN_VIEW_PER_S
    assert ratio[beyond] == pytest.approx(most)
    assert ratio[found.in_view_standing == found.in_view] == pytest.approx(1.0)


@pytest.mark.parametrize("ego_mps", [10.0, 30.0])
def test_a_vehicle_that_stands_may_have_entered_the_range_at_the_egos_speed(ego_mps: float) -> None:
    """Fast, the ego is far inside the range of a stopped car before the first detections of it."""
    lon = np.linspace(70.0, 99.5, 60)
    found = places_of([(each, LANE) for each in lon], belief_of([]), ego_mps=ego_mps)
    zone_m = max(newborn.RANGE_EDGE_M, newborn.SHADOW_EDGE_S * ego_mps)
    inside = np.clip((SENSOR.range_m - lon) / zone_m - 0.5, 0.0, 1.0)
    assert found.in_view_standing == pytest.approx(inside)
    assert (found.in_view > inside + 1e-9).any() == (ego_mps == 30.0)
