from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.sensor.shadows import SECTORS, free_space, shadow_polygons
from mmpf.scan import BodySizes, Detections, EgoPose
from tests.harness.sensor.sensor_scenes import MIDDLE, ROAD

EGO = EgoPose(lon_m=300.0, lat_m=MIDDLE, heading_rad=0.0, speed_mps=20.0, length_m=4.7, width_m=1.9)


def detections_at(*offsets):
    lon, lat = np.array(offsets, dtype=float).reshape(-1, 2).T
    nothing, std = np.full(len(lon), np.nan), np.full(len(lon), 0.3)
    return Detections(300.0 + lon, MIDDLE + lat, nothing, std, std, nothing)


def free_range(detections, bearing, **options):
    space = free_space(detections, EGO, ROAD, 100.0, **options)
    return space.range_m[int((bearing + np.pi) / (2 * np.pi) * SECTORS)]


def test_without_detections_the_sensor_sees_to_its_range_all_round():
    assert free_space(detections_at(), EGO, ROAD, 100.0).range_m == pytest.approx(np.full(SECTORS, 100.0))


def test_sight_ends_at_the_far_side_of_the_first_car_and_is_free_beside_it():
    detections = detections_at((30.0, 0.0), (60.0, 0.0), (-20.0, 0.0))
    assert free_range(detections, 0.001) == pytest.approx(32.35, abs=0.01)
    assert free_range(detections, np.pi - 0.001) == pytest.approx(22.35, abs=0.01)
    assert free_range(detections, -np.pi + 0.001) == pytest.approx(22.35, abs=0.01)
    assert free_range(detections, 0.1) == 100.0


def test_sight_ends_at_the_far_side_of_the_measured_body():
    std = np.full(2, 0.1)
    sizes = BodySizes(np.array([12.0, 4.0]), np.array([2.5, 1.7]), std, std)
    detections = replace(detections_at((30.0, 0.0), (-20.0, 0.0)), sizes=sizes)
    assert free_range(detections, 0.001) == pytest.approx(36.0, abs=0.01)
    assert free_range(detections, np.pi - 0.001) == pytest.approx(22.0, abs=0.01)
    # The near corner of the wide body stands at (24, 1.25) m; that of a mean car at (27.65, 0.95) m.
    between = 0.5 * (np.arctan2(1.25, 24.0) + np.arctan2(0.95, 27.65))
    assert free_range(detections, between) < 36.1
    assert free_range(replace(detections, sizes=None), between) == 100.0


def test_a_false_detection_on_the_sensor_itself_blinds_nothing():
    assert (free_space(detections_at((0.5, 0.1)), EGO, ROAD, 100.0).range_m == 100.0).all()
    assert shadow_polygons(detections_at((0.5, 0.1)), EGO, ROAD, 100.0) == []


def test_outside_the_field_of_view_nothing_is_free():
    assert free_range(detections_at(), np.pi / 2, field_of_view_rad=np.pi / 2) == 0.0
    assert free_range(detections_at(), 0.3, field_of_view_rad=np.pi / 2) == 100.0


def test_a_shadow_is_drawn_from_the_far_side_of_the_car_to_the_range():
    (outline,) = shadow_polygons(detections_at((30.0, 0.0)), EGO, ROAD, 100.0)
    shadow = shapely.Polygon(outline - (300.0, MIDDLE))
    assert shadow.is_valid
    half_angle = np.arctan2(0.95, 27.65)
    assert shadow.bounds[2] == pytest.approx(100.0, rel=1e-3)
    wedge = half_angle * 100.0**2 - 27.65 * 0.95
    body_in_wedge = 4.7 * 1.9
    assert shadow.area == pytest.approx(wedge - body_in_wedge, rel=1e-3)


@settings(max_examples=40, deadline=None)
@given(st.tuples(st.floats(-90, 90), st.floats(-9, 9)))
def test_drawn_shadow_and_free_space_tell_the_same_story(offset):
    detections = detections_at(offset)
    outlines = shadow_polygons(detections, EGO, ROAD, 100.0)
    bearings = -np.pi + 2 * np.pi / SECTORS * (np.arange(SECTORS) + 0.5)
    ends = free_space(detections, EGO, ROAD, 100.0).range_m
    behind = np.minimum(ends + 0.5, 99.0)
    points = shapely.points(300.0 + behind * np.cos(bearings), MIDDLE + behind * np.sin(bearings))
    shadow = shapely.union_all([shapely.Polygon(outline) for outline in outlines])
    assert (shapely.contains(shadow, points) == (ends < 98.0)).mean() > 1 - 3 / SECTORS
    before = shapely.points(300.0 + (ends - 0.05) * np.cos(bearings), MIDDLE + (ends - 0.05) * np.sin(bearings))
    assert not shapely.contains(shadow, before).any()
