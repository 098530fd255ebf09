"""Vehicle or false object: what place of birth, regularity, speed and overlap say, each in the smallest scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mmpf.joint.ghosts import (
    LARGEST_LOG_ODDS,
    Sightings,
    first_log_odds,
    log_odds_at_birth,
    overlap_log_odds,
    regularity_log_odds,
    shadow_wrong_after,
    speed_log_odds,
    stood_log_after,
    waiting_shares,
    with_log_odds,
)

from mmpf.around.reach import Reach
from mmpf.cloud.birth import Traffic
from mmpf.cloud.mixture import Mixture
from mmpf.cloud.moments import Moments, component_moments
from mmpf.compute.arrays import FloatArray
from mmpf.joint_options import JointFalseObjects, JointGhosts, JointOptions, JointRegularity
from mmpf.lanes.control import FREE, NO_SIGNAL, YIELD, LinkControl
from mmpf.options import FilterOptions
from mmpf.scan import SensorModel
from mmpf.state import LAT, LON, SPEED
from tests.mmpf.lanes.scenes import graph_of
from tests.mmpf.scenes import belief_of, lane_centre, spot
from tests.mmpf.test_update_rules import situation_with

OPTIONS, FALSE, REGULARITY, SENSOR = JointGhosts(), JointFalseObjects(), JointRegularity(), SensorModel()
DT_S = 0.1
LANE = lane_centre(2)
IN_VIEW, OUT_OF_VIEW = (np.log(p / (1.0 - p)) for p in (OPTIONS.vehicle_in_view, OPTIONS.vehicle_out_of_view))
FLOW = Traffic(np.array([0.0, 30.0, 60.0]), np.array([20.0, 20.0, 20.0]))


def born_at(places: list[tuple[float, float]], mixture: Mixture) -> FloatArray:
    return log_odds_at_birth(
        np.arange(len(places)), mixture, component_moments(mixture), situation_with(places), FilterOptions()
    )


def moving(speeds_mps: list[float], std_mps: float = 0.5) -> Moments:
    mean, variance = np.zeros((6, len(speeds_mps))), np.full((6, len(speeds_mps)), std_mps**2)
    mean[SPEED] = speeds_mps
    return Moments(mean, variance)


def sighting(
    hit: float, detected: float = 0.95, run: float = 0.0, shadow_wrong: float = 0.5, reach: float = 1.0
) -> Sightings:
    not_seen = np.array([1.0 - (1.0 - run) * detected])
    return Sightings(np.array([hit]), not_seen, np.array([run]), np.array([shadow_wrong]), np.array([reach]))


def sighted(
    hit: float, detected: float = 0.95, run: float = 0.0, unseen_s: float = 0.0, shadow_wrong: float = 0.5
) -> float:
    sightings = sighting(hit, detected, run, shadow_wrong)
    return float(regularity_log_odds(sightings, np.array([unseen_s]), SENSOR, JointOptions(), DT_S)[0])


def test_what_appears_in_plain_view_is_hardly_a_vehicle_and_what_leaves_a_shadow_or_comes_into_range_is_one() -> None:
    front = belief_of([spot(15.0, LANE)], confirmed=[True])
    found = born_at([(40.0, lane_centre(0)), (40.0, LANE), (99.0, lane_centre(0))], front)
    assert found == pytest.approx([IN_VIEW, OUT_OF_VIEW, OUT_OF_VIEW])


@pytest.mark.parametrize("column", [{"confirmed": [False]}, {"confirmed": [True], "vehicle_log_odds": [-1.0]}])
def test_what_is_not_known_for_a_vehicle_explains_no_appearance(column: dict[str, list[float]]) -> None:
    assert born_at([(40.0, LANE)], belief_of([spot(15.0, LANE)], **column)) == pytest.approx([IN_VIEW])


def test_towards_the_ranges_edge_vehicles_appear_ever_more_probably() -> None:
    places = [(lon, lane_centre(2)) for lon in np.linspace(80.0, 99.5, 40)]
    found = born_at(places, belief_of([]))
    assert (np.diff(found) >= 0.0).all()
    assert found[[0, -1]] == pytest.approx([IN_VIEW, OUT_OF_VIEW])


def test_of_the_first_scan_nothing_is_known_beforehand() -> None:
    assert first_log_odds(2, OPTIONS) == pytest.approx([OUT_OF_VIEW] * 2)


def test_one_that_stands_among_flowing_traffic_is_no_vehicle_and_one_that_flows_may_be() -> None:
    standing, flowing = speed_log_odds(moving([0.0, 20.0]), FLOW, FALSE, 40.0, 0.0)
    assert standing < -4.0
    assert flowing == pytest.approx(-np.log(1.0 - FALSE.standing_share), abs=1e-3)


def test_one_that_was_seen_to_move_and_stops_amid_flowing_traffic_is_no_false_object_that_stands() -> None:
    speeds = [20.0, 12.0, 4.0, 0.0, 0.0]
    stood = np.zeros(1)
    for speed in speeds:
        stood = stood_log_after(stood, moving([speed]), FALSE)
    stopped = speed_log_odds(moving([0.0]), FLOW, FALSE, 40.0, 0.0, stood)
    assert stopped == pytest.approx(-np.log(1.0 - FALSE.standing_share), abs=1e-3)


def test_a_speed_that_is_hardly_known_proves_no_motion() -> None:
    assert stood_log_after(np.zeros(1), moving([8.0], std_mps=4.0), FALSE) == 0.0


@given(st.lists(st.floats(0.0, 40.0), min_size=1, max_size=6))
def test_the_order_of_the_speeds_means_nothing_for_whether_it_ever_moved(speeds: list[float]) -> None:
    def after(ordered: list[float]) -> float:
        stood = np.zeros(1)
        for speed in ordered:
            stood = stood_log_after(stood, moving([speed]), FALSE)
        return float(stood[0])

    assert after(speeds) == after(speeds[::-1]) == after([max(speeds)])


def test_where_roads_meet_vehicles_wait_and_standing_says_little() -> None:
    crossing = replace(FLOW, lat_m=np.array([0.0, 5.0, -5.0]))
    standing, flowing = speed_log_odds(moving([0.0, 20.0]), crossing, FALSE, 40.0, FALSE.waiting_share)
    assert standing == pytest.approx(np.log(FALSE.waiting_share / FALSE.standing_share), abs=1e-2)
    assert flowing == pytest.approx(np.log((1.0 - FALSE.waiting_share) / (1.0 - FALSE.standing_share)), abs=1e-2)


def test_vehicles_wait_before_stop_lines_rather_than_elsewhere() -> None:
    """Two lanes lead to a line where way must be given, the first 60 m and the second 30 m long; one leads on."""
    graph = graph_of(
        {"far": [(0.0, 0.0), (60.0, 0.0)], "near": [(60.0, 0.0), (90.0, 0.0)], "on": [(90.0, 0.0), (200.0, 0.0)]},
        links=[("far", "near"), ("near", "on")],
    )
    none = np.full(2, NO_SIGNAL)
    control = LinkControl(np.array([FREE, YIELD]), none, (), np.zeros(0, dtype=np.int64), np.zeros(3, dtype=np.int64))
    graph = replace(graph, control=control)
    np.testing.assert_allclose(graph.to_stop_line_m, [30.0, 0.0, np.inf])
    moments = replace(moving([0.0] * 5), direction_rad=np.zeros(5))
    moments.mean[LON] = [30.0, 50.0, 85.0, 95.0, 50.0]
    moments.mean[LAT] = [0.0, 0.0, 0.0, 0.0, 40.0]
    options = JointFalseObjects(waiting_share_elsewhere=0.1, waiting_share_at_line=0.6)
    np.testing.assert_array_equal(waiting_shares(moments, graph, options), [0.1, 0.6, 0.6, 0.1, 0.1])
    assert waiting_shares(moments, None, options) == 0.0
    assert waiting_shares(moments, replace(graph, control=None), options) == options.waiting_share


def test_where_all_stand_standing_says_little() -> None:
    jam = replace(FLOW, speed_mps=np.zeros(3))
    assert -1.5 < speed_log_odds(moving([0.0]), jam, FALSE, 40.0, 0.0)[0] < 0.0


@given(st.floats(0.0, 40.0), st.floats(0.1, 8.0))
def test_a_speed_never_says_more_for_a_vehicle_than_that_it_is_none_of_those_that_stand(
    speed_mps: float, std_mps: float
) -> None:
    found = speed_log_odds(moving([speed_mps], std_mps), FLOW, FALSE, 40.0, 0.0)[0]
    assert found <= -np.log(1.0 - FALSE.standing_share) + 1e-9


def test_a_scan_in_plain_view_weighs_as_the_two_kinds_detection_probabilities_do() -> None:
    lasts = DT_S / FALSE.life_s
    assert sighted(1.0) == pytest.approx(np.log(0.95 / FALSE.seen_probability) + lasts)
    assert sighted(0.0) == pytest.approx(np.log(0.05 / (1.0 - FALSE.seen_probability)))
    assert sighted(0.3) == pytest.approx(0.3 * sighted(1.0) + 0.7 * sighted(0.0))


@given(st.floats(0.65, 1.0))
def test_detected_as_often_as_a_vehicle_it_becomes_one(detected: float) -> None:
    sensor = replace(SENSOR, detection_probability=detected)
    each = Sightings(np.array([1.0, 0.0]), np.full(2, 1.0 - detected), np.zeros(2), np.zeros(2), np.ones(2))
    seen, missed = regularity_log_odds(each, np.zeros(2), sensor, JointOptions(), DT_S)
    assert detected * seen + (1.0 - detected) * missed >= 0.0


def test_where_the_sensor_sees_little_a_detection_says_as_much_and_a_miss_hardly_anything() -> None:
    far = sighting(1.0, detected=0.95 * 0.2, reach=0.2), sighting(0.0, detected=0.95 * 0.2, reach=0.2)
    seen, missed = (float(regularity_log_odds(each, np.zeros(1), SENSOR, JointOptions(), DT_S)[0]) for each in far)
    assert seen == pytest.approx(sighted(1.0))
    assert sighted(0.0) < -2.0 < -0.2 < missed < 0.0


def test_where_the_sensor_was_found_to_see_little_a_newcomer_in_plain_view_is_probably_a_vehicle() -> None:
    distance = np.full(1000, 75.0)
    blind = Reach.of_data_sheet(100.0).after(distance, np.ones(1000), np.zeros(1000), kept=1.0)
    nobody, place = belief_of([]), [(75.0, LANE)]
    situation = replace(situation_with(place), reach=blind)
    found = log_odds_at_birth(np.arange(1), nobody, component_moments(nobody), situation, FilterOptions())
    assert found[0] > 0.5 * OUT_OF_VIEW > 0.0 > born_at(place, nobody)[0]


def test_detected_as_often_as_a_false_object_it_becomes_one() -> None:
    seen = FALSE.seen_probability
    assert seen * sighted(1.0) + (1.0 - seen) * sighted(0.0) < 0.0


@given(st.floats(0.0, 1.0), st.floats(0.02, 0.95), st.floats(0.0, 0.95))
def test_a_miss_says_little_for_a_vehicle_however_deep_the_shadow(wrong: float, detected: float, run: float) -> None:
    assert sighted(0.0, detected=detected, run=run, shadow_wrong=wrong) <= REGULARITY.largest_miss_log_odds
    deep = sighted(0.0, detected=0.02, shadow_wrong=0.0)
    assert deep == REGULARITY.largest_miss_log_odds


def filtered(hits: list[bool], detected: float) -> tuple[float, list[float]]:
    """Return the log odds that a row of scans adds, and the belief that the shadow is wrong after each."""
    wrong, odds, beliefs = REGULARITY.shadow_wrong, 0.0, []
    for hit in hits:
        odds += sighted(float(hit), detected=detected, shadow_wrong=wrong)
        wrong = float(shadow_wrong_after(sighting(float(hit), detected, 0.0, wrong), SENSOR, REGULARITY, DT_S)[0])
        beliefs.append(wrong)
    return odds, beliefs


def test_one_detected_scan_after_scan_in_a_shadow_is_a_vehicle_whose_shadow_is_wrong() -> None:
    odds, wrong = filtered([True] * 20, detected=0.02)
    assert odds > 3.0
    assert wrong[-1] > 0.9


def test_one_missed_scan_after_scan_in_a_shadow_proves_the_shadow() -> None:
    assert filtered([False] * 20, detected=0.02)[1][-1] < 0.05


@given(st.lists(st.booleans(), min_size=1, max_size=12), st.floats(0.02, 0.94))
def test_the_belief_in_wrong_shadows_is_that_of_the_two_state_chain_worked_out_by_matrices(
    hits: list[bool], detected: float
) -> None:
    forgotten = -np.expm1(-DT_S / REGULARITY.shadow_wrong_s)
    share = REGULARITY.shadow_wrong
    transition = (1.0 - forgotten) * np.eye(2) + forgotten * np.array([[share, 1.0 - share]])
    belief = np.array([share, 1.0 - share])
    for hit in hits:
        seen = np.array([SENSOR.detection_probability, detected])
        belief = belief * (seen if hit else 1.0 - seen)
        belief = belief / belief.sum() @ transition
    assert filtered(hits, detected)[1][-1] == pytest.approx(belief[0], abs=1e-9)


@given(st.floats(0.0, 1.0), st.booleans(), st.floats(0.0, 0.95))
def test_in_plain_view_nothing_is_learned_of_shadows(wrong: float, hit: bool, run: float) -> None:
    in_view = sighting(float(hit), SENSOR.detection_probability, run, wrong)
    after = float(shadow_wrong_after(in_view, SENSOR, REGULARITY.model_copy(update={"shadow_wrong_s": 1e9}), DT_S)[0])
    assert after == pytest.approx(wrong, abs=1e-6)


def test_who_returns_in_plain_view_after_a_run_of_misses_is_the_more_a_vehicle_the_longer_it_was() -> None:
    gained = np.array([sighted(1.0, unseen_s=scans * DT_S) for scans in range(12)])
    assert (np.diff(gained) >= -1e-9).all()
    most = REGULARITY.gap_credit * REGULARITY.largest_gap_scans * -np.log(1.0 - FALSE.seen_probability)
    assert gained[-1] - gained[0] == pytest.approx(most)
    in_shadow = [sighted(1.0, detected=0.02, unseen_s=unseen_s) for unseen_s in (0.0, 1.0)]
    assert in_shadow[1] - in_shadow[0] < 0.01, "in a shadow a vehicle is missed anyway"


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 0.95), st.floats(0.0, 0.7))
def test_the_more_certain_a_detection_the_more_a_vehicle_if_it_is_in_plain_view(
    less: float, more: float, run: float, unseen_s: float
) -> None:
    low, high = sorted([less, more])
    assert sighted(high, run=0.2 * run, unseen_s=unseen_s) >= sighted(low, run=0.2 * run, unseen_s=unseen_s) - 1e-9


def test_of_two_seen_sources_in_one_place_the_one_that_is_less_of_a_vehicle_loses() -> None:
    mixture = belief_of([spot(30.0, LANE), spot(31.0, LANE), spot(60.0, LANE)], vehicle_log_odds=[4.0, 1.0, 0.0])
    moments = component_moments(mixture)
    seen = np.ones(3, dtype=np.bool_)
    for dt_s in (0.1, 0.3):
        found = overlap_log_odds(mixture.components, moments, seen, OPTIONS, dt_s)
        assert found == pytest.approx([0.0, -OPTIONS.overlap_per_s * dt_s, 0.0])
    hidden = np.array([False, True, True])
    assert (overlap_log_odds(mixture.components, moments, hidden, OPTIONS, DT_S) == 0.0).all()


@given(st.floats(-20.0, 20.0), st.floats(0.0, 1.0))
def test_no_source_is_ever_so_certain_that_nothing_could_change_it(odds: float, hit: float) -> None:
    mixture = belief_of([spot(30.0, LANE)], source_log_odds=[odds])
    sightings = sighting(hit)
    after = with_log_odds(
        mixture.components,
        mixture.components,
        component_moments(mixture),
        sightings,
        situation_with([]),
        FilterOptions(),
    )
    assert abs(after.source_log_odds[0]) <= LARGEST_LOG_ODDS
