"""In the plane, gates and errors lie along each vehicle: scores are the same whichever way the map is turned."""

import numpy as np
import pandas as pd
import pytest

from harness.scoring.evidence.directions import along_and_across, along_axes
from tests.harness.scoring.scenes import Scene, score_run, traffic

# Deviations are along the axes of the map, and so are the errors that they are held against. A quarter turn exchanges
# the axes: that changes the coverage along each, and no score of the axis nearer to each vehicle's direction.
COVERAGE = ("calibration.coverage95", "calibration.visible.coverage95", "calibration.hidden.coverage95")
OF_AXES = (*COVERAGE, "hidden.hidden_crps_m")


def leaves(table, path=""):
    if isinstance(table, dict):
        for key, value in table.items():
            yield from leaves(value, f"{path}.{key}" if path else key)
    elif isinstance(table, list):
        for place, value in enumerate(table):
            yield from leaves(value, f"{path}.{place}")
    else:
        yield path, np.nan if table is None else table


def numbers_of(metrics):
    return {path: repr(value) for path, value in leaves(metrics)}


def numbers(scores, left_out=()):
    return {path: value for path, value in leaves(scores.metrics) if not path.startswith(left_out)}


def headed(tables, direction_rad):
    """Return the tables of a run in the plane: vehicles have directions, and deviations no axis."""
    truth, detections, tracks = tables
    return truth.assign(direction_rad=direction_rad), detections, tracks.assign(std_lon_m=0.7, std_lat_m=0.7)


def turned(tables, angle_rad, shift_m=(1000.0, -500.0)):
    truth, detections, tracks = (table.copy() for table in tables)
    for table in (truth, detections, tracks):
        x, y = table["lon_m"].to_numpy(), table["lat_m"].to_numpy()
        table["lon_m"] = np.cos(angle_rad) * x - np.sin(angle_rad) * y + shift_m[0]
        table["lat_m"] = np.sin(angle_rad) * x + np.cos(angle_rad) * y + shift_m[1]
    truth["direction_rad"] = np.remainder(truth["direction_rad"] + angle_rad + np.pi, 2 * np.pi) - np.pi
    return truth, detections, tracks


def crossing(seed=0):
    """Return the jam of the other tests as traffic of which every third vehicle heads another way."""
    tables = traffic(steps=120, vehicles=24, seed=seed)
    number = tables[0]["vehicle_id"].str.removeprefix("car").astype(int)
    return headed(tables, np.where(number % 3 == 0, 0.5 * np.pi, np.where(number % 3 == 1, 0.3, np.pi)))


@pytest.mark.parametrize("angle_rad", [0.4, 0.5 * np.pi, 2.5, -np.pi])
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_turning_the_map_changes_no_score(angle_rad, seed):
    tables, quarters = crossing(seed), angle_rad / (0.5 * np.pi)
    left_out = COVERAGE if quarters == round(quarters) else OF_AXES
    here, there = (numbers(score_run(*run), left_out) for run in (tables, turned(tables, angle_rad)))
    assert there == pytest.approx(here, rel=1e-6, abs=1e-9, nan_ok=True)
    assert min(here["mot.id_switches"], here["occlusion.events"]) > 0


def test_vehicles_that_all_head_along_x_are_scored_as_on_a_road_with_a_frame():
    truth, detections, tracks = traffic(steps=120, vehicles=24)
    road = score_run(truth, detections, tracks)
    plane = score_run(truth.assign(direction_rad=0.0), detections, tracks)
    by_manoeuvre = plane.metrics.pop("manoeuvre")
    assert plane.metrics.pop("unseen_turns")["events"] == 0
    # In the plane a track heads where it went in the last half second, on a road where its velocity points.
    for state in (*plane.metrics["motion"].values(), *road.metrics["motion"].values()):
        assert None not in (state.pop("heading_deg"), state.pop("heading_n"))
    assert plane.metrics == road.metrics
    assert "manoeuvre" not in road.metrics
    assert by_manoeuvre["straight"]["speed_mps"] == pytest.approx(
        (road.metrics["mae"]["visible"]["speed_mps"] * road.metrics["mae"]["visible"]["n"]
        + road.metrics["mae"]["partial"]["speed_mps"] * road.metrics["mae"]["partial"]["n"])
        / (road.metrics["mae"]["visible"]["n"] + road.metrics["mae"]["partial"]["n"])
    )  # fmt: skip
    pd.testing.assert_frame_equal(plane.errors, road.errors)


@pytest.mark.parametrize(
    ("direction_rad", "away", "matched"),
    [
        (0.0, (3.5, 0.0), True),
        (0.0, (0.0, 3.5), False),
        (0.5 * np.pi, (3.5, 0.0), False),
        (0.5 * np.pi, (0.0, 3.5), True),
        (0.25 * np.pi, (2.4, 2.4), True),
        (0.25 * np.pi, (2.4, -2.4), False),
        (0.25 * np.pi, (5.5, 5.5), False),
    ],
)
def test_the_gate_is_long_along_the_vehicle_and_narrow_across_it(direction_rad, away, matched):
    scene = Scene(20).vehicle("a", lon=30.0, lat=-7.0, detected=True).track(1, lon=30.0 + away[0], lat=-7.0 + away[1])
    truth, detections, tracks = scene.tables()
    scores = score_run(truth.assign(direction_rad=direction_rad), detections, tracks)
    assert (scores.errors["outcome"] == "tracked").all() == matched
    row = scores.metrics["mae"]["visible"]
    if matched:
        along = away[0] * np.cos(direction_rad) + away[1] * np.sin(direction_rad)
        assert row["lon_m"] == pytest.approx(abs(along))
        assert row["position_m"] == pytest.approx(np.hypot(*away))


def test_a_false_detection_has_the_gate_that_a_true_one_would_have_there():
    def tracks_in_sight(direction_rad, away):
        # Nothing comes from the hidden car, but something false is always where it is.
        scene = Scene(40).vehicle("a", lon=20.0, state="hidden").clutter(np.arange(40), lon=20.0)
        truth, detections, tracks = scene.track(1, lon=20.0 + away[0], lat=away[1]).tables()
        truth = truth.assign(direction_rad=np.where(truth["is_ego"], 0.0, direction_rad))
        return score_run(truth, detections, tracks).metrics["mot"]["tracks_n"]

    assert tracks_in_sight(0.5 * np.pi, (0.0, 3.0)) == tracks_in_sight(0.0, (3.0, 0.0)) == 40
    # Out of sight once half a second is over.
    assert tracks_in_sight(0.0, (0.0, 3.0)) == tracks_in_sight(0.5 * np.pi, (3.0, 0.0)) == 6


def test_errors_of_detections_are_along_and_across_the_vehicle_that_they_came_from():
    truth, detections, tracks = Scene(5).vehicle("a", lon=10.0, detected=True).tables()
    detections = detections.assign(lat_m=detections["lat_m"] + 0.3)
    noise = score_run(truth.assign(direction_rad=0.5 * np.pi), detections, tracks).metrics["detection_noise"]
    assert (noise["lon_m"], noise["lat_m"]) == pytest.approx((0.3, 0.0))


def test_deviations_are_held_against_errors_along_the_axes_that_they_are_of():
    # 3 m off along a car that heads along y, whose tracker is sure of x alone.
    truth, detections, tracks = Scene(20).vehicle("a", lon=30.0, detected=True).track(1, lon=30.0, lat=3.0).tables()
    tracks = tracks.assign(std_lon_m=0.1, std_lat_m=3.0, std_speed_mps=1.0)
    scores = score_run(truth.assign(direction_rad=0.5 * np.pi), detections, tracks).metrics
    assert scores["mae"]["visible"]["lon_m"] == pytest.approx(3.0)
    assert scores["calibration"]["coverage95"] == {"lon": 100.0, "lat": 100.0, "speed": 100.0}
    assert scores["calibration"]["nees"] == pytest.approx(1.0 / 3.0)


def test_turning_differences_there_and_back_leaves_them():
    rng = np.random.default_rng(0)
    lon, lat, direction = rng.normal(size=(3, 100))
    back = along_axes(*along_and_across(lon, lat, direction), direction)
    np.testing.assert_allclose(back, (lon, lat), atol=1e-12)
    along, across = along_and_across(lon, lat, direction)
    turned_back = (along + 1j * across) * np.exp(1j * direction)
    np.testing.assert_allclose(turned_back, lon + 1j * lat, atol=1e-12)


def test_persons_on_foot_are_in_no_score():
    truth, detections, tracks = crossing()
    plain = score_run(truth, detections, tracks).metrics
    walker = truth[truth["vehicle_id"] == truth["vehicle_id"].iloc[1]].assign(vehicle_id="person:a", lat_m=30.0)
    walked = pd.concat([truth.assign(pedestrian=False), walker.assign(pedestrian=True)], ignore_index=True)
    assert numbers_of(score_run(walked, detections, tracks).metrics) == numbers_of(plain)
