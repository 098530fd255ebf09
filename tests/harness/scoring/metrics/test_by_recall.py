"""AMOTA and AMOTP of cases whose values follow from nuScenes' published rules by hand."""

import numpy as np
import pandas as pd
import pytest

from harness.scoring.metrics.by_recall import filled_in, scores_by_class

COLUMNS = ["scene", "time_s", "id", "category", "x_m", "y_m"]


def rows(boxes, scores=None):
    table = pd.DataFrame([("a", time_s, name, kind, x, 0.0) for time_s, name, kind, x in boxes], columns=COLUMNS)
    return table if scores is None else table.assign(score=scores)


def times(count):
    return pd.DataFrame({"scene": "a", "time_s": 0.5 * np.arange(count)})


def still(name, x, count, begin=0, kind="car"):
    return [(0.5 * step, name, kind, x) for step in range(begin, begin + count)]


def test_a_perfect_tracker_has_accuracy_one_and_its_own_distance():
    truth = rows(still("v", 0.0, 10))
    tracks = rows(still("t", 0.5, 10), [0.9] * 10)
    (car,) = scores_by_class(truth, tracks, times(10)).values()
    assert (car.amota, car.amotp) == pytest.approx((1.0, 0.5), abs=1e-12)


def test_a_vehicle_of_two_that_is_never_found_costs_the_recalls_above_a_half():
    truth = rows(still("v", 0.0, 10) + still("w", 50.0, 10))
    tracks = rows(still("t", 0.5, 10), [0.9] * 10)
    recalls = np.linspace(0.1, 1.0, 40).round(12)
    reached = (recalls <= 0.5).sum()
    (car,) = scores_by_class(truth, tracks, times(10)).values()
    # With recall 1/2, misses are not counted twice: MOTAR is 1 - (10 - 10) / 10.
    assert car.amota == pytest.approx(reached / 40, abs=1e-12)
    assert car.amotp == pytest.approx((0.5 * reached + 2.0 * (40 - reached)) / 40, abs=1e-12)


def test_a_switch_and_false_boxes_count_against_the_matches():
    # Two tracks follow one vehicle for 5 samples each; a third, of the same score, follows nothing for 4.
    truth = rows(still("v", 0.0, 10))
    tracks = rows(still("t", 1.0, 5) + still("u", 1.0, 5, begin=5) + still("f", 9.0, 4), [0.5] * 14)
    (car,) = scores_by_class(truth, tracks, times(10)).values()
    # The match at the switch is none by these rules: 9 of 10 boxes are matched, 1 switched, 0 missed, 4 are false.
    accuracy = 1.0 - (0 + 1 + 4 - (10 - 9)) / 9
    reached = (np.linspace(0.1, 1.0, 40).round(12) <= 0.9).sum()
    assert car.amota == pytest.approx(accuracy * reached / 40, abs=1e-12)
    assert car.amotp == pytest.approx((1.0 * reached + 2.0 * (40 - reached)) / 40, abs=1e-12)


def test_low_scores_are_left_out_where_the_recall_is_reached_without_them():
    # The false track has the lower score: only the recalls above one half, which need the second true track, see it.
    truth = rows(still("v", 0.0, 10) + still("w", 50.0, 10))
    tracks = rows(
        still("t", 0.0, 10) + still("f", 90.0, 10) + still("u", 50.0, 10), [0.9] * 10 + [0.5] * 10 + [0.3] * 10
    )
    (car,) = scores_by_class(truth, tracks, times(10)).values()
    recalls = np.linspace(0.1, 1.0, 40).round(12)
    thresholds = np.interp(recalls, np.arange(1, 21) / 20, [0.9] * 10 + [0.3] * 10)
    values = [1.0 if threshold > 0.5 else 1.0 - 10 / (10 if threshold > 0.3 else 20) for threshold in thresholds]
    assert car.amota == pytest.approx(np.mean(values), abs=1e-12)


def test_classes_are_matched_apart_and_one_without_tracks_has_the_worst_values():
    truth = rows(still("v", 0.0, 4) + still("p", 0.0, 4, kind="pedestrian"))
    scores = scores_by_class(truth, rows(still("t", 0.0, 4), [0.5] * 4), times(4))
    assert (scores["car"].amota, scores["pedestrian"].amota, scores["pedestrian"].amotp) == (1.0, 0.0, 2.0)


def test_a_gap_of_a_track_is_filled_half_way_and_its_ends_are_not_prolonged():
    boxes = rows([(0.5, "t", "car", 1.0), (1.5, "t", "car", 3.0)], [0.4, 0.6])
    found = filled_in(boxes, times(6)).sort_values("time_s")
    assert found[["time_s", "x_m"]].to_numpy().tolist() == [[0.5, 1.0], [1.0, 2.0], [1.5, 3.0]]
