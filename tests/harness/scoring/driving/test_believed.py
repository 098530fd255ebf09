"""Tracks and vehicles as bodies that a driver may believe in: their lengths, directions and speeds by hand."""

import numpy as np
import pandas as pd
import pytest

from harness.scoring.driving.believed import egos_of, tracked_bodies, true_bodies
from harness.scoring.evidence.rows import read_run
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from mmpf.map.corridor_road import highway
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
from tests.harness.scoring.scenes import Scene

STEPS = np.arange(12)


def tables(in_plane: bool = True) -> list[pd.DataFrame]:
    """Return a run of a car that drives on a diagonal, a track on it, and one that stands."""
    scene = Scene(12).vehicle("a", lon=20.0 + STEPS, lat=STEPS.astype(float), detected=STEPS % 3 == 0)
    scene.track(5, lon=20.0 + STEPS, lat=STEPS.astype(float), speed=np.where(STEPS == 2, np.nan, 14.0))
    truth, detections, tracks = scene.track(9, lon=50.0, at=STEPS[4:]).tables()
    truth = truth.assign(length_m=np.where(truth["is_ego"], 5.5, 4.0), width_m=1.6, lane=2)
    detections = detections.assign(length_m=[4.0, 6.0, np.nan, 8.0], width_m=[1.0, 2.0, 9.0, 3.0])
    return [truth.assign(direction_rad=0.25 * np.pi) if in_plane else truth, detections, tracks]


def bodies_of(made: list[pd.DataFrame]):
    rows = read_run(*made)
    egos, there = egos_of(made[0], rows)
    road = LaneGraphRoad(without_map()) if "direction_rad" in made[0] else highway()
    return rows, egos, there, tracked_bodies(made[1], rows, egos, road)


def of_track(rows, values, number: int) -> np.ndarray:
    chosen = np.flatnonzero(rows.tracks.track_id == number)
    return values[chosen[np.argsort(rows.tracks.step[chosen])]]


def test_a_track_points_where_it_went_over_the_last_half_second_if_it_went_anywhere():
    rows, _, _, bodies = bodies_of(tables())
    moving = of_track(rows, bodies.direction_rad, 5)
    assert np.isnan(moving[0])
    np.testing.assert_allclose(moving[1:], 0.25 * np.pi)
    assert np.isnan(of_track(rows, bodies.direction_rad, 9)).all()
    made = tables()
    made[2].loc[(made[2]["track_id"] == 5) & (made[2]["step"] == 8), ["lon_m", "lat_m"]] = (20.0 + 3.0, 8.0)
    rows, _, _, bodies = bodies_of(made)
    assert of_track(rows, bodies.direction_rad, 5)[8] == pytest.approx(0.5 * np.pi)
    rows, _, _, bodies = bodies_of(tables(in_plane=False))
    assert not bodies.direction_rad.any()


def test_half_a_metre_is_far_enough_to_tell_a_direction_and_less_is_not():
    for away_m, known in ((0.5, True), (0.49, False)):
        made = tables()
        made[2].loc[made[2]["track_id"] == 9, "lat_m"] = np.where(STEPS[4:] < 6, 0.0, away_m)
        rows, _, _, bodies = bodies_of(made)
        assert np.isfinite(of_track(rows, bodies.direction_rad, 9)).any() == known


def test_a_track_is_as_large_as_the_mean_of_what_was_measured_on_it_so_far():
    rows, _, _, bodies = bodies_of(tables())
    length, width = (of_track(rows, values, 5) for values in (bodies.length_m, bodies.width_m))
    assert length.tolist() == [4.0] * 3 + [5.0] * 6 + [6.0] * 3
    assert width.tolist() == [1.0] * 3 + [1.5] * 6 + [2.0] * 3
    assert set(of_track(rows, bodies.length_m, 9)) == {NOMINAL_LENGTH_M}
    assert set(of_track(rows, bodies.width_m, 9)) == {NOMINAL_WIDTH_M}
    made = tables()
    rows, _, _, bodies = bodies_of([made[0], made[1].drop(columns="width_m"), made[2]])
    assert set(bodies.length_m) == {NOMINAL_LENGTH_M}
    assert set(bodies.width_m) == {NOMINAL_WIDTH_M}


def test_a_track_without_a_speed_is_as_fast_as_the_ego():
    made = tables()
    made[0].loc[made[0]["is_ego"], "speed_mps"] = 3.0 + STEPS
    rows, _, _, bodies = bodies_of(made)
    assert of_track(rows, bodies.speed_mps, 5).tolist() == [14.0, 14.0, 5.0] + [14.0] * 9


def test_where_there_is_no_ego_its_place_is_unknown():
    made = tables()
    made[0] = made[0][~(made[0]["is_ego"] & (made[0]["step"] == 7))]
    rows, egos, there, _ = bodies_of(made)
    assert there.tolist() == [step != 7 for step in range(12)]
    assert np.isnan([egos.lon_m[7], egos.lat_m[7]]).all()
    assert (egos.speed_mps[7], egos.lane[7], egos.length_m[7], egos.width_m[7]) == (
        0.0, 0, NOMINAL_LENGTH_M, NOMINAL_WIDTH_M,
    )  # fmt: skip
    assert (egos.speed_mps[6], egos.lane[6], egos.length_m[6], egos.width_m[6]) == (10.0, 2, 5.5, 1.6)
    assert (egos.lon_m[6], egos.lat_m[6], egos.episode.tolist()) == (0.0, 0.0, [0] * 12)
    bare, *others = made
    rows = read_run(bare, *others)
    plain = egos_of(bare.drop(columns=["lane", "length_m", "width_m"]), rows)[0]
    assert (plain.lane[6], plain.length_m[6], plain.width_m[6]) == (0, NOMINAL_LENGTH_M, NOMINAL_WIDTH_M)


def test_true_vehicles_are_as_the_truth_says():
    made = tables()
    rows = read_run(*made)
    bodies = true_bodies(made[0], rows)
    assert bodies.step.tolist() == STEPS.tolist()
    assert bodies.lon_m.tolist() == (20.0 + STEPS).tolist()
    assert bodies.lat_m.tolist() == STEPS.tolist()
    assert (set(bodies.speed_mps), set(bodies.length_m), set(bodies.width_m)) == ({10.0}, {4.0}, {1.6})
    assert set(bodies.direction_rad) == {0.25 * np.pi}
