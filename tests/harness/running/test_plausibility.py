"""What can be read and is unlikely is told of; a plain scene is not."""

import pandas as pd
import pytest

from harness.running.plausibility import implausible_reports, implausible_truth, warn_of_implausible
from mmpf.map.corridor_road import highway
from tests.harness.recorded_scene import detection_table, track_table, truth_table

KINDS = {
    "points": "heading_rad = 1.5", "as fast": "speed_mps = 3.6 * speed_mps", "259 km/h": "lon_m = 4 * lon_m",
    "at once": "lon_m = lon_m + 7 * (step % 20)", "is where another is": "lon_m = 100 + 2 * step",
    "usual": "length_m = 15", "its size": "length_m = 4 + (step > 30) * 3", "wider": "width_m = length_m + 0.1",
    "26 m": "length_m = 3000",
    "not as fast": "speed_mps = -speed_mps", "at one moment": "vehicle_id = index", "lanes": "lane = 0",
    "stands where another is": "lon_m = 100\nspeed_mps = 0",
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_what_no_vehicle_does_is_told_of_and_what_one_does_is_not(kind):
    assert not implausible_truth(truth_table({}), highway())
    assert any(kind in found for found in implausible_truth(truth_table({}).eval(KINDS[kind]), highway()))


@pytest.mark.parametrize(
    ("kind", "warned"), [("speed_mps = 0\nlon_m = 50", False), ("width_m = 0.7", False), ("speed_mps = 20", True)]
)
def test_a_parked_vehicle_that_is_annotated_twice_and_a_rider_are_usual(kind, warned):
    lanes = [truth_table({name: f"{name}{lane}" for name in ("ego", "near", "far")}) for lane in range(4)]
    one = truth_table({}).query("vehicle_id == 'near'").eval(f"lat_m = 50\n{kind}")
    many = [rows.assign(lat_m=4 * lane) for lane, rows in enumerate(lanes)]
    found = implausible_truth(pd.concat([*many, one, one.assign(vehicle_id="twice")]))
    assert any("where another is" in each for each in found) == warned


def test_detections_and_tracks_in_another_frame_are_told_of_once_a_run(capsys):
    told = set()
    tables = {"truth": truth_table({}), "detections": detection_table({}), "tracks": track_table()}
    for lat_m in (5.0, 25.0, 25.0):
        moved = {f"{key}.parquet": rows.assign(lat_m=lat_m) if key != "truth" else rows for key, rows in tables.items()}
        warn_of_implausible(moved, highway(), told)
    (line,) = capsys.readouterr().err.splitlines()
    assert "detections are over 10 m from their vehicles; tracks are over 10 m from any" in line


def test_tracks_near_none_but_vehicles_out_of_range_are_told_of_with_their_distance():
    beyond = truth_table({}).eval("lon_m = lon_m + 500\nin_range = False\nis_ego = False")
    tracks = track_table().eval("lon_m = lon_m + 500")
    told = implausible_reports(pd.concat([truth_table({}), beyond]), detection_table({}), tracks)
    # Most tracks follow the vehicle that is 25 m behind the last one in range.
    assert told == ["tracks are over 10 m from any vehicle (median 475 m)"]


def test_tracks_that_follow_clutter_are_no_fault_of_their_frame():
    detections, tracks = detection_table({}), track_table().assign(lat_m=25.0)
    assert implausible_reports(truth_table({}), detections, tracks)
    clutter = tracks.assign(truth_id="")
    assert not implausible_reports(truth_table({}), pd.concat([detections, clutter]), tracks)
