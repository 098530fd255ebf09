"""Rules of the scores exactly at their boundaries, and their numbers by hand on scenes of a few rows."""

from types import SimpleNamespace

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.scoring.driving.asked import _times
from harness.scoring.driving.encroachment import TimedPath, _first_crossing, _pieces, encounter
from harness.scoring.evidence.assignment import best_assignment, components
from harness.scoring.evidence.directions import nearest_row
from harness.scoring.evidence.events import _track_ids, row_after
from harness.scoring.evidence.history import last_row_where
from harness.scoring.evidence.stretches import stretches
from harness.scoring.metrics.clear import ClearScores
from harness.scoring.metrics.closedloop import BY_COLLISION, IN_TIME, Contact, DriveRecord, score_drive
from harness.scoring.metrics.conflicts import ConflictPart, conflicts
from harness.scoring.metrics.coverage import NoisePart, detection_noise
from harness.scoring.metrics.hidden_by import cause_between
from harness.scoring.metrics.manoeuvre import heading_rate, manoeuvre_between
from harness.scoring.metrics.parts import combined
from harness.scoring.metrics.scarce import check_scored
from harness.scoring.metrics.unseen_turns import TurnsPart, _way, scores_of_turns


def scarce(truth_n: int, steps: int, in_range: int = 5, detected: int = 4) -> str:
    coverage = {"vehicles_in_range": in_range, "detected": detected}
    try:
        check_scored({"mot": {"truth_n": truth_n}, "coverage": coverage}, steps)
    except InputError as error:
        return str(error)
    return ""


def test_a_run_with_a_vehicle_in_sight_in_a_twentieth_of_its_steps_is_scored_and_one_with_less_is_not():
    assert scarce(5, 100) == scarce(1, 10) == scarce(1, 20) == ""
    assert "4 vehicle-steps in sight in 100 steps, because vehicles are hardly ever" in scarce(4, 100)
    assert "because no vehicle comes within" in scarce(0, 10, in_range=0)
    assert "because none of the vehicles in range is detected" in scarce(0, 10, detected=0)


def test_parts_of_clear_add_up():
    whole = combined([ClearScores(5, 1, 2, 1, 3), ClearScores(3, 4, 0, 2, 1)])
    assert whole == ClearScores(8, 5, 2, 3, 4)
    assert whole.mota == (8 - 2 - 3) / 13
    assert [ClearScores(0, *rest, 0, 0).mota for rest in ((3, 0), (0, 3), (3, 1))] == [0.0, 0.0, -1 / 3]


def test_parts_of_the_detections_noise_add_up():
    both = detection_noise([NoisePart(3.0, 1.0, 4), NoisePart(1.0, 0.5, 1)], None)
    assert both == {"lon_m": 0.8, "lat_m": 0.3, "n": 5}
    nothing = detection_noise([NoisePart(0.0, 0.0, 0)], None)
    assert (np.isnan(nothing["lon_m"]), np.isnan(nothing["lat_m"]), nothing["n"]) == (True, True, 0)


def test_parts_of_unseen_turns_add_up():
    parts = [TurnsPart(3, 2, 1), None, TurnsPart(1, 1, 1)]
    assert scores_of_turns(parts, None) == {"right_route_percent": 75.0, "foreseen_percent": 50.0, "events": 4}
    assert scores_of_turns([None], None) == {}
    assert np.isnan([*scores_of_turns([TurnsPart(0, 0, 0)], None).values()][:2]).all()


def test_conflicts_are_counted_below_and_above_their_limits_not_at_them():
    part = ConflictPart(
        np.array([1.5, 1.49, 3.0, 2.99, np.inf]), np.array([3.4, 3.41, 0.0, np.inf]), np.array([2.0, 0.5])
    )
    told = conflicts([part, None, ConflictPart(np.zeros(0), np.zeros(0), np.array([4.0]))], None)
    assert told == {
        "n": 5, "ttc_below_1_5_percent": 20.0, "ttc_below_3_percent": 60.0, "ttc_min_s": 1.49,
        "drac_above_3_4_percent": 50.0, "drac_p95_mps2": pytest.approx(3.4 + 0.95 * 0.01), "drac_max_mps2": 3.41,
        "closing_n": 2, "pet_n": 3, "pet_min_s": 0.5, "pet_median_s": 2.0,
    }  # fmt: skip
    assert conflicts([None], None) == {}
    nothing = conflicts([ConflictPart(np.zeros(0), np.zeros(0), np.zeros(0))], None)
    assert [key for key, value in nothing.items() if value == 0] == ["n", "closing_n", "pet_n"]
    assert np.isnan([value for key, value in nothing.items() if key not in ("n", "closing_n", "pet_n")]).all()


def test_a_drive_is_told_in_these_numbers():
    nothing = np.zeros(4)
    driven = DriveRecord(
        np.array([10.0, 8.0, 7.5, 7.5]), np.array([14.4, 100.0, np.inf, 12.0]), np.array([0.0, 0.0, 0.0, 20.0]),
        np.array([-2.0, -2.0, -1.0, 0.0]), np.array([-1.0, -0.9, -2.0, -2.0]), 0.5,
    )  # fmt: skip
    told = score_drive(driven, BY_COLLISION, Contact("x", 0.2, 1.5, into=False))
    km = 0.5 * (9.0 + 7.75 + 7.5) / 1e3
    jerk = np.array([(-1.0 + 4.0) / 0.5, 2.0])
    assert told == {
        "ended": "collision", "drives_s": 1.5, "km": pytest.approx(km), "collided_percent": 100.0, "collided_with": "x",
        "ran_into": 0.0, "collision_time_s": 0.2, "impact_mps": 1.5, "ttc_below_1_5_percent": 25.0,
        "drac_above_3_4_percent": 25.0, "hard_brakes": 1, "hard_brakes_per_km": pytest.approx(1 / km), "missed": 1,
        "missed_withheld": 0,
        "missed_per_km": pytest.approx(1 / km), "phantom": 1, "phantom_per_km": pytest.approx(1 / km),
        "mean_speed_mps": pytest.approx(1e3 * km / 1.5), "jerk_mps3": pytest.approx(np.sqrt((jerk**2).mean())),
    }  # fmt: skip
    short = score_drive(DriveRecord(*[nothing[:2]] * 5, 0.1), IN_TIME, None)
    assert short["jerk_mps3"] is None
    assert [short[key] for key in ("hard_brakes_per_km", "collided_with", "ran_into", "collision_time_s")] == [None] * 4
    assert (short["km"], short["collided_percent"], short["missed"]) == (0.0, 0.0, 0)


def test_stretches_end_with_what_holds_and_with_the_episode():
    holds, episode = np.array([1, 1, 0, 1, 1, 1, 0, 1], dtype=bool), np.array([0, 0, 0, 0, 0, 1, 1, 1])
    assert [each.tolist() for each in stretches(holds, episode)] == [[0, 3, 5, 7], [1, 4, 5, 7]]
    assert [each.tolist() for each in stretches(holds[:0], episode[:0])] == [[], []]


def test_a_step_lasts_until_the_next_and_the_last_of_an_episode_as_long_as_usual():
    rows = SimpleNamespace(time_s=np.array([0.0, 0.1, 0.3, 5.0, 5.2, 5.4]), episode=np.array([0, 0, 0, 1, 1, 1]))
    lasts, since = _times(rows)
    np.testing.assert_allclose(lasts, [0.1, 0.2, 0.2, 0.2, 0.2, 0.2])
    np.testing.assert_allclose(since, [0.0, 0.1, 0.3, 0.0, 0.2, 0.4], atol=1e-12)
    one = _times(SimpleNamespace(time_s=np.array([7.0]), episode=np.array([0])))
    assert [each.tolist() for each in one] == [[0.1], [0.0]]
    none = _times(SimpleNamespace(time_s=np.zeros(0), episode=np.zeros(0)))
    assert [each.tolist() for each in none] == [[], []]


def path(*places: tuple[float, float], begin_s: float = 3.0) -> TimedPath:
    x, y = np.array(places).T
    return TimedPath(x, y, begin_s + np.arange(len(x), dtype=float))


def test_a_place_on_a_path_is_reached_between_its_steps_and_its_ends_belong_to_it():
    along = path((0.0, 0.0), (3.0, 4.0), (3.0, 6.0))
    assert [along.time_at(m) for m in (0.0, 2.5, 5.0, 6.0, 7.0)] == [3.0, 3.5, 4.0, 4.5, 5.0]
    assert (along.time_at(-0.001), along.time_at(7.001)) == (None, None)


def test_places_within_six_metres_of_a_paths_box_come_near():
    along = path((0.0, 10.0), (20.0, 30.0))
    inside = [(-6.0, 4.0), (26.0, 36.0), (10.0, 20.0), (-6.0, 36.0)]
    outside = [(-6.1, 10.0), (26.1, 10.0), (0.0, 3.9), (0.0, 36.1)]
    assert [along.comes_near(np.array([x]), np.array([y])) for x, y in (*inside, *outside)] == [True] * 4 + [False] * 4
    assert along.comes_near(np.array([500.0, 0.0]), np.array([500.0, 10.0]))
    assert not along.comes_near(np.zeros(0), np.zeros(0))
    assert not TimedPath(*[np.zeros(0)] * 3).comes_near(np.zeros(1), np.zeros(1))


def test_standing_and_jumps_are_no_pieces_of_a_path():
    assert _pieces(path((0, 0), (0, 0), (9.9, 0), (9.9, 0.1), (19.9, 0.1), (29.8, 0.1))).tolist() == [1, 2, 4]


def test_the_first_crossing_is_told_by_both_arc_lengths_and_its_angle():
    own = path((0.0, 0.0), (4.0, 0.0), (8.0, 0.0), (12.0, 0.0))
    other = path((9.0, -6.0), (9.0, -2.0), (9.0, 2.0), (9.0, 6.0))
    assert _first_crossing(own, other) == pytest.approx((9.0, 6.0, 0.5 * np.pi))
    assert _first_crossing(other, own) == pytest.approx((6.0, 9.0, 0.5 * np.pi))
    begins = path((0.0, -4.0), (0.0, 0.0), (0.0, 4.0))
    assert _first_crossing(own, begins) == pytest.approx((0.0, 4.0, 0.5 * np.pi))
    assert _first_crossing(own, path((12.0, -4.0), (12.0, 0.0), (12.0, 4.0))) is None
    assert _first_crossing(own, path((9.0, -6.0))) is None
    for degrees, crosses in ((19.0, False), (21.0, True), (159.0, True), (161.0, False), (181.0, False)):
        way = np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))])
        oblique = path(*[tuple(np.array([6.0, 0.0]) + m * way) for m in (-7.0, -3.0, 1.0, 5.0)])
        found = _first_crossing(own, oblique)
        assert (found is not None) == crosses, degrees
        if found is not None:
            assert found == pytest.approx((6.0, 7.0, np.deg2rad(degrees)))


def test_an_encounter_that_the_record_does_not_hold_whole_is_none():
    own = path(*[(4.0 * k, 0.0) for k in range(8)], begin_s=0.0)

    def time_to(begin: int, end: int, begin_s: float) -> float | None:
        other = path(*[(14.0, 4.0 * k) for k in range(begin, end)], begin_s=begin_s)
        met = encounter(own, (4.0, 2.0), other, (4.0, 2.0))
        return met and met.time_s

    # Both cover the crossing from 3 m before to 3 m behind it: the ego from 2.75 to 4.25 s.
    assert time_to(-3, 4, 3.0) == pytest.approx((6.0 - 0.75) - 4.25)
    assert time_to(-3, 4, -3.0) == pytest.approx(2.75 - 0.75)
    assert time_to(-3, 1, 3.0) is None
    assert time_to(0, 4, 3.0) is None
    assert encounter(own, (4.0, 2.0), path((500.0, 0.0), (500.0, 4.0)), (4.0, 2.0)) is None


class Truth(SimpleNamespace):
    """Truth rows of which only some columns are known."""

    def __len__(self) -> int:
        return len(self.time_s)


def truth_of(time_s, vehicle, **other) -> Truth:
    return Truth(time_s=np.array(time_s, dtype=float), vehicle=np.array(vehicle), **other)


def test_the_row_after_a_delay_is_of_the_same_vehicle_and_at_least_that_late():
    truth = truth_of([0.0, 0.1, 0.2, 0.3, 0.0, 0.1], [0, 0, 0, 0, 1, 1])
    rows = SimpleNamespace(time_s=np.array([0.0, 0.1, 0.2, 0.3]), truth=truth)
    assert row_after(rows, np.arange(6), 0.2).tolist() == [2, 3, -1, -1, -1, -1]
    assert row_after(rows, np.arange(6), 0.15).tolist() == [2, 3, -1, -1, -1, -1]
    assert row_after(rows, np.arange(6), 0.0).tolist() == [0, 1, 2, 3, 4, 5]


def test_the_rate_of_a_heading_is_over_a_second_to_either_side_and_winds_through_half_a_turn():
    time_s = np.concatenate([0.1 * np.arange(31), 0.1 * np.arange(10), 0.1 * np.arange(11)])
    vehicle = np.repeat([0, 1, 2], [31, 10, 11])
    turned = 3.0 + 0.5 * time_s
    truth = truth_of(time_s, vehicle, direction_rad=np.remainder(turned + np.pi, 2 * np.pi) - np.pi)
    rate = heading_rate(truth)
    np.testing.assert_allclose(rate[:31], 0.5)
    np.testing.assert_allclose(rate[31:41], 0.0)
    np.testing.assert_allclose(rate[41:], 0.5)
    bend = truth_of(0.1 * np.arange(31), np.zeros(31, int), direction_rad=np.where(np.arange(31) < 15, 0.0, 0.3))
    assert heading_rate(bend)[[4, 5, 15, 24, 25]] == pytest.approx([0.0, 0.3 / 1.5, 0.15, 0.3 / 1.6, 0.0])
    assert heading_rate(truth_of([], [], direction_rad=np.zeros(0))).tolist() == []


def test_a_turn_counts_from_its_onset_to_its_return_both_included():
    code = np.array([1, 0, 0, 2, 0, 3, 4, 0])
    begin, end = np.array([0, 1, 1, 2, 4, 4, 0, 7]), np.array([2, 2, 3, 4, 5, 6, 3, 7])
    assert manoeuvre_between(code, begin, end).tolist() == [1, 0, 2, 2, 3, 4, 2, 0]


def test_a_cause_is_that_of_more_than_half_of_the_hidden_steps():
    by_wall, hidden = np.array([1, 1, 0, 0, 1, 1], dtype=bool), np.array([0, 1, 1, 1, 1, 1], dtype=bool)
    begin, end = np.array([0, 1, 1, 3, 0, 5]), np.array([1, 2, 4, 5, 5, 5])
    assert cause_between(by_wall, hidden, begin, end).tolist() == [1, 0, 0, 1, 1, 1]


def test_the_last_row_of_a_group_where_something_holds_is_no_other_groups():
    condition = np.array([0, 1, 0, 1, 0, 0, 1], dtype=bool)
    assert last_row_where(condition, np.array([0, 0, 0, 0, 5, 5, 5])).tolist() == [-1, 1, 1, 3, -1, -1, 6]
    assert last_row_where(condition[:0], np.zeros(0, int)).tolist() == []


def test_a_way_goes_on_straight_beyond_both_its_ends_which_lie_before_and_after_the_time_unseen():
    time_s = 0.1 * np.arange(200)
    truth = truth_of(
        np.concatenate([time_s, time_s]), np.repeat([0, 1], 200), lon_m=np.tile(np.arange(200.0), 2),
        lat_m=np.repeat([0.0, 50.0], 200), direction_rad=np.concatenate([np.zeros(199), [0.5 * np.pi], np.zeros(200)]),
    )  # fmt: skip
    way = _way(truth, 60, 199)
    first = int(way[1, 0])
    assert way[0].tolist() == [first - 10.0, 0.0]
    assert way[-1] == pytest.approx([199.0, 10.0])
    assert way[1:-1, 0].tolist() == list(np.arange(first, 200.0))
    assert set(way[:-1, 1]) == {0.0}
    assert 0 < first < 60
    other = _way(truth, 260, 270)
    assert set(other[:, 1]) == {50.0}
    assert other[-1, 0] - 10.0 < 199.0


def test_the_nearest_vehicle_to_a_detection_is_one_of_its_own_step():
    found = nearest_row(
        np.array([1, 0]), np.array([0.0, 5.0]), np.zeros(2),
        np.array([0, 1, 1, 0]), np.array([0.0, 9.0, -3.0, 6.0]), np.array([0.0, 0.0, 0.0, 1.0]),
    )  # fmt: skip
    assert found.tolist() == [2, 3]
    assert nearest_row(*[np.zeros(0)] * 6).tolist() == []


def test_pairs_that_share_an_item_are_one_component_and_the_best_pairs_of_each_are_chosen():
    left, right = np.array([7, 7, 3, 9, 3]), np.array([0, 4, 4, 2, 8])
    label = components(left, right)
    assert len({label[0], label[1], label[2], label[4]}) == 1
    assert label[3] != label[0]
    assert np.flatnonzero(best_assignment(left, right, np.array([1.0, 5.0, 3.0, 0.1, 2.0]))).tolist() == [1, 3, 4]
    assert np.flatnonzero(best_assignment(left, right, np.array([3.0, 4.0, 5.0, 0.1, 2.0]))).tolist() == [0, 2, 3]


def test_tracks_are_told_by_the_trackers_own_numbers_and_none_by_minus_one():
    rows = SimpleNamespace(tracks=SimpleNamespace(track=np.array([1, 0, 1]), track_id=np.array([70, 80, 70])))
    assert _track_ids(rows, np.array([0, -1, 1])).tolist() == [80, -1, 70]
    without = SimpleNamespace(tracks=SimpleNamespace(track=np.zeros(0, int), track_id=np.zeros(0, int)))
    assert _track_ids(without, np.array([-1])).tolist() == [-1]
