from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmpf.options import Footprint
from mmpf.road import FloatArray
from mmpf.scan import FreeSpace, SensorModel
from mmpf.shadows import depth_table, detection_probabilities, shadowed_share, visible_fractions
from tests.mmpf.scenes import ego_at, lane_centre

VEHICLE = Footprint()


def visibility(lon: list[float], lat: list[float]) -> FloatArray:
    lon_m, lat_m = np.array(lon), np.array(lat)
    table = depth_table(ego_at(), lon_m, lat_m, np.ones(len(lon), dtype=np.bool_), VEHICLE)
    return visible_fractions(ego_at(), lon_m, lat_m, np.arange(len(lon)), table, VEHICLE)


def traced_visibility(lon: FloatArray, lat: FloatArray, rays: int = 4000) -> FloatArray:
    """Share of the rays to points on each vehicle's silhouette that meet no nearer vehicle, ray by ray."""
    ego = ego_at()
    half_length, half_width = 0.5 * VEHICLE.length_m, 0.5 * VEHICLE.width_m
    corners = np.array([(sx * half_length, sy * half_width) for sx in (-1, 1) for sy in (-1, 1)])
    result = np.empty(len(lon))
    for k in range(len(lon)):
        centre = np.array([lon[k] - ego.lon_m, lat[k] - ego.lat_m])
        bearings = np.arctan2(*(centre + corners).T[::-1])
        middle = np.arctan2(centre[1], centre[0])
        relative = np.mod(bearings - middle + np.pi, 2 * np.pi) - np.pi
        angle = middle + np.linspace(relative.min(), relative.max(), rays)
        direction = np.stack([np.cos(angle), np.sin(angle)])
        blocked = np.zeros(rays, dtype=np.bool_)
        for other in range(len(lon)):
            if other == k:
                continue
            box = np.array([lon[other] - ego.lon_m, lat[other] - ego.lat_m])[:, None]
            half = np.array([half_length, half_width])[:, None]
            near, far = (box - half) / direction, (box + half) / direction
            enter, leave = np.minimum(near, far).max(axis=0), np.maximum(near, far).min(axis=0)
            blocked |= (enter <= leave) & (enter > 0.0) & (enter < np.hypot(*centre))
        result[k] = 1.0 - blocked.mean()
    return result


def test_a_car_exactly_behind_another_is_hidden_and_the_nearer_one_is_not() -> None:
    assert visibility([30.0, 50.0], [lane_centre(2)] * 2) == pytest.approx([1.0, 0.0])


def test_a_component_does_not_lie_in_its_own_shadow() -> None:
    assert visibility([30.0], [lane_centre(2)]) == pytest.approx([1.0])


def test_cars_side_by_side_do_not_hide_each_other() -> None:
    assert visibility([30.0, 30.0], [lane_centre(2), lane_centre(4)]) == pytest.approx([1.0, 1.0])


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_the_table_agrees_with_ray_tracing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lane = rng.integers(0, 5, 12)
    lon = np.arange(12) * 12.0 - 70.0 + rng.uniform(-2.0, 2.0, 12)
    keep = ~((np.abs(lon) < 6.0) & (lane == 2))
    lon, lat = lon[keep], np.array([lane_centre(k) for k in lane[keep]])
    difference = np.abs(visibility(list(lon), list(lat)) - traced_visibility(lon, lat))
    assert difference.max() < 0.25
    assert difference.mean() < 0.05


def test_detection_probability_falls_with_the_hidden_share_and_ends_at_the_range() -> None:
    probability = detection_probabilities(
        np.array([1.0, 0.7, 0.35, 0.1, 1.0]), np.array([50.0, 50.0, 50.0, 50.0, 120.0]), SensorModel(), 0.02
    )
    assert probability == pytest.approx([0.95, 0.95, 0.475, 0.02, 0.02])


def test_the_sensors_own_free_space_asserts_occlusion() -> None:
    sectors = np.full(720, 100.0)
    sectors[350:370] = 30.0
    share = shadowed_share(
        ego_at(),
        np.array([20.0, 60.0, 60.0]),
        np.array([lane_centre(2)] * 2 + [lane_centre(2) + 40.0]),
        FreeSpace(sectors),
        VEHICLE,
    )
    assert share == pytest.approx([0.0, 1.0, 0.0])
