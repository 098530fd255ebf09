"""Slopes, clocks and roads of recordings against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.truth.recorded.lanelets import Lanelet, road_from_lanelets
from harness.truth.recorded.motion import HALF_WIDTH_STEPS, local_slope


def brute_force_slope(values, stay):
    slopes = []
    for row in range(len(values)):
        near = [
            k
            for k in range(row - HALF_WIDTH_STEPS, row + HALF_WIDTH_STEPS + 1)
            if 0 <= k < len(values) and stay[k] == stay[row]
        ]
        slopes.append(np.polyfit(0.1 * np.array(near), values[near], 1)[0] if len(near) > 1 else 0.0)
    return np.array(slopes)


@given(st.lists(st.integers(1, 25), min_size=1, max_size=5), st.integers(0, 2**31))
def test_a_slope_is_the_line_of_least_squares_through_neighbours_of_the_same_stay(lengths, seed):
    stay = np.repeat(np.arange(len(lengths)), lengths)
    values = np.random.default_rng(seed).normal(size=len(stay)).cumsum() + 600.0
    np.testing.assert_allclose(local_slope(values, stay), brute_force_slope(values, stay), atol=1e-6)


def bent_lanelets(radius_m: float, turn_rad: float) -> list[Lanelet]:
    """Return three lanes of 3.5 m on an arc to the left, each in two pieces."""
    angles = np.linspace(0.0, turn_rad, 60)
    lanelets = []
    for lane in range(3):
        for piece, part in enumerate((angles[:31], angles[30:])):
            left, right = (
                np.column_stack([r * np.sin(part), radius_m - r * np.cos(part)])
                for r in (radius_m - 3.5 * (lane + 1), radius_m - 3.5 * lane)
            )
            following = (f"{lane}-1",) if piece == 0 else ()
            lanelets.append(Lanelet(f"{lane}-{piece}", left, right, following))
    return lanelets


def test_lanes_of_a_bend_are_strips_of_their_width_and_every_position_maps_back():
    radius_m, turn_rad = 800.0, 0.3
    rng = np.random.default_rng(5)
    angle = rng.uniform(0.03, turn_rad - 0.03, 400)
    lateral = rng.uniform(0.2, 10.3, 400)
    x, y = (radius_m - lateral) * np.sin(angle), radius_m - (radius_m - lateral) * np.cos(angle)
    road = road_from_lanelets(bent_lanelets(radius_m, turn_rad), x, y)
    assert [lane.number for lane in road.lanes] == [1, 2, 3]
    for lane in road.lanes:
        assert lane.left_m - lane.right_m == pytest.approx(3.5, abs=0.1)
    lon, lat = road.to_road(x, y)
    wanted = 3 - (lateral // 3.5).astype(int)
    clear_of_lines = np.abs(lateral - 3.5 * np.round(lateral / 3.5)) > 0.15
    np.testing.assert_array_equal(road.lane_number_at(lon, lat)[clear_of_lines], wanted[clear_of_lines])
    back_x, back_y = road.to_cartesian(lon, lat)
    np.testing.assert_allclose(np.hypot(back_x - x, back_y - y), 0.0, atol=1e-9)


def test_a_ramp_is_a_lane_only_where_it_runs_beside_the_road():
    lines = [np.array([[0.0, 3.5 * k], [300.0, 3.5 * k]]) for k in range(3)]
    straight = [Lanelet(str(k), lines[k + 1], lines[k]) for k in range(2)]
    lon = np.linspace(0.0, 300.0, 100)
    away = np.maximum(0.0, 0.2 * (150.0 - lon))
    ramp = Lanelet("r", np.column_stack([lon, -away]), np.column_stack([lon, -3.5 - away]))
    x = np.linspace(0.0, 300.0, 50)
    road = road_from_lanelets([*straight, ramp], x, np.full(50, 3.0))
    beside = [lane for lane in road.lanes if lane.number == 3]
    assert len(beside) == 1
    assert 140.0 < beside[0].start_m < 150.0
    assert [lane.start_m < -100.0 for lane in road.lanes if lane.number < 3] == [True, True]
