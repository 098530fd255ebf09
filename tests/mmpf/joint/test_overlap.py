"""Bodies that touch while they pass each other or lie on the ego, against draws and a pass that is summed up."""

from dataclasses import replace

import numpy as np
import pytest

from mmpf.belief.mixture import Components, Mixture
from mmpf.belief.moments import component_moments
from mmpf.joint.overlap import driven_through, probability_on_ego
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import FloatArray
from tests.mmpf.scenes import ROAD, belief_of, ego_at, lane_centre, spot

LANE, LEAST_MPS = lane_centre(2), 4.0


def passing(mixture: Mixture, dt_s: float = 0.1) -> tuple[FloatArray, FloatArray]:
    return driven_through(mixture.components, component_moments(mixture), LEAST_MPS, dt_s)


@pytest.mark.parametrize("dt_s", [0.05, 0.1, 0.2])
def test_the_shares_of_a_whole_pass_sum_to_one_at_any_scan_rate(dt_s: float) -> None:
    speed_mps, begin_m = 20.0, -20.0
    summed = 0.0
    for step in range(round(2.0 / dt_s)):
        both = belief_of([spot(0.0, LANE, 0.0), spot(begin_m + speed_mps * dt_s * step, LANE, speed_mps)])
        touch, share_of_way = passing(both, dt_s)
        assert touch[0, 1] == touch[1, 0]
        summed += float(touch[0, 1] * share_of_way[0, 1])
    way_m = float(2.0 * both.components.length_m[0])
    assert summed == pytest.approx(1.0, abs=speed_mps * dt_s / way_m)


@pytest.mark.parametrize("speeds_mps", [(15.0, 15.0), (15.0, 5.0)])
def test_who_meets_head_on_passes_at_the_sum_of_the_speeds(speeds_mps: tuple[float, float]) -> None:
    both = belief_of([spot(0.0, LANE, speeds_mps[0]), spot(1.0, LANE, speeds_mps[1])])
    moments = replace(component_moments(both), heading_rad=np.array([0.0, np.pi]))
    _, share_of_way = driven_through(both.components, moments, LEAST_MPS, 0.1)
    assert share_of_way[0, 1] == pytest.approx(0.1 * sum(speeds_mps) / (2.0 * both.components.length_m[0]))


@pytest.mark.parametrize("beside_m", [0.0, 1.5, 1.9, 2.3, 3.66])
def test_the_probability_of_touching_is_that_of_draws(beside_m: float) -> None:
    """With spreads of 0.3 and 0.2 m on both sides, which the widths exceed by far."""
    rng = np.random.default_rng(7)
    states = spot(0.0, LANE, 0.0, 4000), spot(1.0, LANE + beside_m, 15.0, 4000)
    for state, std_m in zip(states, (0.3, 0.2), strict=True):
        state[LAT] += std_m * rng.standard_normal(4000)
    both = belief_of(states)
    components: Components = both.components
    gap_m = np.abs(states[0][LAT][:, None] - states[1][LAT])
    drawn = (gap_m < 0.5 * components.width_m.sum()).mean()
    assert passing(both)[0][0, 1] == pytest.approx(drawn, abs=0.02)


def test_those_at_one_speed_or_one_behind_the_other_pass_nobody() -> None:
    one_speed = belief_of([spot(0.0, LANE, 15.0), spot(1.0, LANE, 17.0)])
    in_a_row = belief_of([spot(0.0, LANE, 0.0), spot(6.0, LANE, 15.0)])
    assert not passing(one_speed)[0].any()
    assert not passing(in_a_row)[0].any()


@pytest.mark.parametrize(("ahead_m", "beside_m"), [(0.0, 0.0), (2.4, 0.0), (1.0, 1.2), (7.0, 0.0), (0.0, 3.66)])
def test_the_probability_of_lying_on_the_ego_is_that_of_draws(ahead_m: float, beside_m: float) -> None:
    """Two bodies share a place if they are nearer than half of their mean length and half of their mean width."""
    rng, share, ego = np.random.default_rng(8), 0.5, ego_at()
    state = spot(ego.lon_m + ahead_m, ego.lat_m + beside_m, 20.0, 20_000)
    state[[LON, LAT]] += np.array([[0.8], [0.4]]) * rng.standard_normal((2, 20_000))
    one = belief_of([state])
    drawn = np.abs(state[LON] - ego.lon_m) < share * 0.5 * (one.components.length_m + ego.length_m)
    drawn &= np.abs(state[LAT] - ego.lat_m) < share * 0.5 * (one.components.width_m + ego.width_m)
    found = probability_on_ego(one.components, component_moments(one), SensorPlane(ego, ROAD), share)
    assert found == pytest.approx([drawn.mean()], abs=0.01)
