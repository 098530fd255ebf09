"""Tables read as arrays, and the intervals of scores, by hand on a few rows."""

import numpy as np
import pandas as pd
import pytest

from harness.common.bootstrap import cluster_bootstrap, group_sums
from harness.common.intervals import ANY, possible_ci
from harness.scoring.evidence.rows import _codes, _origins, read_run
from harness.scoring.evidence.rules import GATE_LAT_M, GATE_LON_M
from harness.scoring.metrics.gospa import CUTOFF_M
from tests.harness.scoring.scenes import Scene

NAN = float("nan")


def test_codes_are_of_distinct_pairs_and_origins_of_rows_that_are_there():
    assert _codes(np.array([0, 1, 0, 1]), np.array([-2, -2, 5, -2])).tolist() == [0, 2, 1, 2]
    assert _codes(np.zeros(0, int), np.zeros(0, int)).tolist() == []
    step, name = np.array([0, 1, 1, 2]), np.array([1, 0, -1, 1])
    assert _origins(step, name, 2, np.array([1, 0, 0]), np.array([0, 1, 0])).tolist() == [0, 1, -1, -1]
    assert _origins(step, name, 2, np.zeros(0, int), np.zeros(0, int)).tolist() == [-1] * 4


def small(steps: int = 3) -> list[pd.DataFrame]:
    scene = Scene(steps).vehicle("a", lon=np.array([9.0, 10.0, 11.0]), detected=True)
    return list(scene.track(4, lon=np.array([9.0, 10.0, 11.0])).clutter([1], 50.0).tables())


@pytest.mark.parametrize(
    ("table", "column", "value", "problem"),
    [
        (2, "lon_m", NAN, "tracks: a reported track has a position that is not finite"),
        (2, "lat_m", np.inf, "tracks: a reported track has a position that is not finite"),
        (1, "lat_m", NAN, "detections: a detection has a position that is not finite"),
        (1, "step", 7, "detections: step 7 is not in truth"),
        (2, "step", 7, "tracks: step 7 is not in truth"),
        (2, "step", 1, "tracks: a track is reported twice at one step"),
        (2, "state", "odd", "state 'odd' is none of tentative, confirmed, hidden"),
        (2, "state", None, "a state is missing; it must be one of tentative, confirmed, hidden"),
        (0, "direction_rad", NAN, "truth: direction_rad holds a value that is not finite"),
    ],
)
def test_tables_that_contradict_each_other_are_told(table, column, value, problem):
    tables = small()
    if column == "direction_rad":
        tables[0]["direction_rad"] = 0.0
    tables[table].loc[tables[table].index[0], column] = value
    with pytest.raises(ValueError, match=r"^") as caught:
        read_run(*tables)
    assert str(caught.value) == problem


def test_a_vehicle_counts_up_to_the_gate_within_what_is_known_of_the_road_its_edge_included():
    truth, detections, tracks = small()
    window = truth.assign(window_start_m=np.where(truth["step"] == 0, 5.0, 5.1), window_end_m=15.0)
    rows = read_run(window, detections, tracks)
    assert rows.truth.in_range.tolist() == [True, True, True]
    assert rows.tracks.unknowable.tolist() == [False, False, False]
    late = read_run(window.assign(window_start_m=5.1, window_end_m=14.9), detections, tracks)
    assert late.truth.in_range.tolist() == [False, True, False]
    assert late.tracks.unknowable.tolist() == [True, False, True]
    assert read_run(truth.assign(window_start_m=900.0), detections, tracks).truth.in_range.all()


def test_what_a_source_tells_of_walls_roundabouts_and_parked_vehicles_is_taken_along():
    truth, detections, tracks = small()
    plain = read_run(truth, detections, tracks)
    assert (plain.hidden_by_wall, plain.on_roundabout, plain.truth.parked) == (None,) * 3
    assert (plain.has_headings, plain.ego_direction_rad.tolist()) == (False, [0.0] * 3)
    assert plain.detections.truth_row.tolist() == [0, 1, 2, -1]
    place = truth["step"].to_numpy()
    told = read_run(
        truth.assign(
            wall_fraction=np.array([0.3, 0.31, 0.5])[place], visible_fraction=0.4, on_roundabout=place == 1,
            parked=place == 2, direction_rad=0.1 * place, pedestrian=False,
        ),
        detections, tracks,
    )  # fmt: skip
    assert told.hidden_by_wall.tolist() == [False, True, True]
    assert told.on_roundabout.tolist() == [False, True, False]
    assert told.truth.parked.tolist() == [False, False, True]
    assert told.has_headings
    assert told.ego_direction_rad.tolist() == [0.0, 0.1, 0.2]
    assert told.truth.direction_rad.tolist() == [0.0, 0.1, 0.2]
    assert told.detections.direction_rad.tolist() == [0.0, 0.1, 0.2, 0.1]
    walker = read_run(truth.assign(pedestrian=truth["vehicle_id"] == "a"), detections, tracks)
    assert len(walker.truth) == 0
    assert walker.detections.truth_row.tolist() == [-1] * 4


def test_sums_over_groups_leave_out_what_is_missing_column_by_column():
    values = np.array([[1.0, NAN], [2.0, 5.0], [NAN, 7.0], [4.0, 1.0]])
    sums, counts = group_sums(values, np.array([0, 0, 2, 2]))
    assert sums.tolist() == [[3.0, 5.0], [0.0, 0.0], [4.0, 8.0]]
    assert counts.tolist() == [[2.0, 1.0], [0.0, 0.0], [1.0, 2.0]]
    assert group_sums(np.zeros((0, 2)), np.zeros(0, int))[0].shape == (0, 2)


def test_intervals_by_resampling_are_the_quantiles_of_means_of_groups_drawn_with_replacement(monkeypatch):
    sums, counts = np.array([[3.0, 1.0], [4.0, 0.0], [8.0, 0.0]]), np.array([[1.0, 1.0], [2.0, 0.0], [2.0, 0.0]])
    weights = np.random.default_rng(4).multinomial(3, np.full(3, 1 / 3), size=500)
    means = (weights @ sums[:, 0]) / (weights @ counts[:, 0])
    for most in (2_000_000, 300):
        monkeypatch.setattr("harness.common.bootstrap.MOST_WEIGHTS", most)
        first, second = cluster_bootstrap(sums, counts, np.random.default_rng(4), 500)
        assert (first.low, first.high) == pytest.approx(tuple(np.quantile(means, (0.025, 0.975))))
        assert np.isnan([second.low, second.high]).all()
    alone = cluster_bootstrap(sums[:1], counts[:1], np.random.default_rng(4))
    assert np.isnan([end for each in alone for end in (each.low, each.high)]).all()
    assert len(alone) == 2
    usual = cluster_bootstrap(sums, counts, np.random.default_rng(4))[0]
    drawn = np.random.default_rng(4).multinomial(3, np.full(3, 1 / 3), size=1000)
    assert usual.low == pytest.approx(np.quantile((drawn @ sums[:, 0]) / (drawn @ counts[:, 0]), 0.025))


def test_students_interval_of_a_ratio_by_hand():
    sums, counts = np.array([2.0, 9.0, 5.0]), np.array([1.0, 3.0, 0.0])
    mean = 11.0 / 4.0
    residual = np.array([2.0 - mean, 9.0 - 3 * mean]) / 4.0
    half = 12.7062047 * np.sqrt(2.0 * (residual**2).sum())
    found = possible_ci(sums, counts, ANY)
    assert (found.low, found.high) == pytest.approx((mean - half, mean + half))


def test_vehicles_and_tracks_are_compared_up_to_the_cut_off_of_gospa():
    assert 2.0 * min(GATE_LON_M, GATE_LAT_M) >= CUTOFF_M
