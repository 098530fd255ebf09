"""What can be read and is unlikely is told of; a plain scene is not."""

from __future__ import annotations

import numpy as np
import pytest

from harness.running.odd import oddities, tell_oddities
from mmpf.map.corridor_road import highway
from tests.harness.recorded_scene import detection_table, track_table, truth_table

KINDS = {
    "points": {"heading_rad": lambda rows: rows["heading_rad"] + 1.5},
    "fast as it says": {"speed_mps": lambda rows: 3.6 * rows["speed_mps"]},
    "259 km/h": {"lon_m": lambda rows: 4.0 * rows["lon_m"]},
    "at once": {"lon_m": lambda rows: rows["lon_m"] + 7.0 * (rows["step"] % 20)},
    "another is": {"lon_m": lambda rows: 100.0 + 2.0 * rows["step"]},
    "changes its size": {"length_m": lambda rows: np.where(rows["step"] > 30, 7.0, 4.0)},
    "wider than long": {"width_m": lambda rows: rows["length_m"] + 0.1},
    "longer than 26 m": {"length_m": lambda rows: 3000.0},
    "at one moment": {"vehicle_id": lambda rows: rows.index.astype(str)},
    "lanes": {"lane": lambda rows: 0},
    "usual size": {"length_m": lambda rows: rows["length_m"] / 0.3048},
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_no_vehicle_does_is_told_of_and_what_one_does_is_not(kind):
    truth, road = truth_table({}), highway()
    assert not oddities(truth, road)
    assert any(kind in found for found in oddities(truth.assign(**KINDS[kind]), road))


def test_detections_and_tracks_in_another_frame_are_told_of_once(capsys):
    tables = {
        "truth.parquet": truth_table({}),
        "detections.parquet": detection_table({}),
        "tracks.parquet": track_table(),
    }
    tell_oddities(tables, highway())
    assert not capsys.readouterr().err
    tables = {name: rows.assign(lat_m=25.0) if name != "truth.parquet" else rows for name, rows in tables.items()}
    tell_oddities(tables, highway())
    tell_oddities(tables, highway())
    (line,) = capsys.readouterr().err.splitlines()
    assert "detections are over 10 m from their vehicles; tracks are over 10 m from any" in line
