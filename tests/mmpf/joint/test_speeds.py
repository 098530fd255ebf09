"""What speeds say of the kind of a source: of standing, of moving once, and of stopping amid flowing traffic."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmpf.belief.birth import Traffic
from mmpf.belief.moments import Moments
from mmpf.joint.kinds import MOVING, STANDING, VEHICLE
from mmpf.joint.sources import Sources
from mmpf.joint.speeds import (
    FLOW_STD_MPS,
    STANDING_STD_MPS,
    STOPPED_AT_LINE,
    STOPPED_ELSEWHERE,
    STOPPED_IN_PLANE,
    log_speed_likelihoods,
    stood_log_after,
    stopped_among,
    stopped_shares,
)
from mmpf.map.control import FREE, NO_SIGNAL, YIELD, LinkControl
from mmpf.map.corridor_road import highway
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import LaneGraph
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.numerics.arrays import FloatArray
from mmpf.options.joint import JointSpeeds
from tests.mmpf.map.scenes import graph_of

E, OPTIONS = np.exp(-1.0), JointSpeeds()
RANGE_M = 40.0
STOPPED = 0.02
FLOW = Traffic(np.array([0.0, 30.0, 60.0]), np.array([20.0, 20.0, 20.0]))
speeds_mps = st.floats(0.0, 40.0)


def moving(speeds_mps: list[float], std_mps: float = 0.5) -> Moments:
    mean, variance = np.zeros((6, len(speeds_mps))), np.full((6, len(speeds_mps)), std_mps**2)
    mean[SPEED] = speeds_mps
    return Moments(mean, variance, np.zeros(mean.shape[1]))


def likelihoods(
    speed_mps: float, std_mps: float = 0.5, stood_log: float = 0.0, traffic: Traffic = FLOW, stopped: float = STOPPED
) -> FloatArray:
    return log_speed_likelihoods(moving([speed_mps], std_mps), traffic, RANGE_M, stopped, stood_log)[0]


def stood_after(speeds: list[float], std_mps: float = 0.5) -> float:
    stood = np.zeros(1)
    for speed in speeds:
        stood = stood_log_after(stood, moving([speed], std_mps))
    return float(stood[0])


def density(speed_mps: float, mean_mps: float, std_mps: float) -> float:
    """A normal density, up to the root of two pi."""
    return float(np.exp(-0.5 * ((speed_mps - mean_mps) / std_mps) ** 2) / std_mps)


@given(speeds_mps, st.floats(0.1, 2.0), st.floats(0.01, 0.9))
def test_each_kinds_likelihood_is_that_of_its_speeds_blurred_by_what_is_not_known(
    speed_mps: float, std_mps: float, stopped: float
) -> None:
    standing = density(speed_mps, 0.0, np.hypot(std_mps, STANDING_STD_MPS))
    flowing = density(speed_mps, 20.0, np.hypot(std_mps, FLOW_STD_MPS))
    expected = {VEHICLE: stopped * standing + (1.0 - stopped) * flowing, STANDING: standing, MOVING: flowing}
    found = np.exp(likelihoods(speed_mps, std_mps, stopped=stopped))
    assert found[list(expected)] == pytest.approx(list(expected.values()), abs=1e-11)


@given(st.lists(speeds_mps, min_size=1, max_size=6))
def test_what_stood_at_its_fastest_moment_fits_standing_as_that_moment_does(speeds: list[float]) -> None:
    variance = STANDING_STD_MPS**2 + 0.5**2
    assert stood_after(speeds) == pytest.approx(-0.5 * max(speeds) ** 2 / variance)


def test_a_speed_that_is_hardly_known_proves_no_motion() -> None:
    assert stood_after([8.0], std_mps=4.0) == 0.0


def test_where_all_stand_standing_says_little() -> None:
    found = likelihoods(0.0, traffic=replace(FLOW, speed_mps=np.zeros(3)))
    assert -1.5 < found[VEHICLE] - found[STANDING] < 0.0


def stop_line() -> LaneGraph:
    """Two lanes lead to a line where way must be given, the first 60 m and the second 30 m long; one leads on."""
    graph = graph_of(
        {"far": [(0.0, 0.0), (60.0, 0.0)], "near": [(60.0, 0.0), (90.0, 0.0)], "on": [(90.0, 0.0), (200.0, 0.0)]},
        links=[("far", "near"), ("near", "on")],
    )
    none = np.full(2, NO_SIGNAL)
    control = LinkControl(np.array([FREE, YIELD]), none, (), np.zeros(0, dtype=np.int64), np.zeros(3, dtype=np.int64))
    return replace(graph, control=control)


def test_vehicles_stand_before_stop_lines_rather_than_elsewhere() -> None:
    graph = stop_line()
    np.testing.assert_allclose(graph.to_stop_line_m, [30.0, 0.0, np.inf])
    moments = moving([0.0] * 5)
    moments.mean[LON] = [30.0, 50.0, 85.0, 95.0, 50.0]
    moments.mean[LAT] = [0.0, 0.0, 0.0, 0.0, 40.0]
    before, elsewhere = STOPPED_AT_LINE, STOPPED_ELSEWHERE
    found = stopped_shares(moments, LaneGraphRoad(graph), OPTIONS)
    np.testing.assert_array_equal(found, [elsewhere, before, before, elsewhere, elsewhere])
    assert before > elsewhere


def test_where_no_stop_line_is_known_one_share_holds_for_all() -> None:
    moments = moving([0.0])
    assert stopped_shares(moments, highway(), OPTIONS) == OPTIONS.stopped_on_road
    assert stopped_shares(moments, LaneGraphRoad(replace(stop_line(), control=None)), OPTIONS) == STOPPED_IN_PLANE


@pytest.mark.parametrize(
    ("behind_m", "beside_m", "speed_mps", "exists", "share"),
    [(0.0, 0.0, 0.0, 1.0, 1.1 / 2.0), (0.0, 0.0, 0.0, 0.5, 0.6 / 1.5), (20.0, 0.0, 0.0, 1.0, (0.1 + E) / (1.0 + E)),
     (20.0, 0.0, 20.0, 1.0, 0.1), (300.0, 0.0, 0.0, 1.0, 0.1), (20.0, 12.0, 0.0, 1.0, 0.1)],
)  # fmt: skip
def test_who_is_near_a_stopped_vehicle_has_probably_stopped_too(behind_m, beside_m, speed_mps, exists, share) -> None:
    pair = moving([0.0, speed_mps], std_mps=0.0)
    pair.mean[LON, 1], pair.mean[LAT, 1] = -behind_m, beside_m
    vehicles = Sources.newborn(np.array([1, 2]), np.array([1.0, exists]))
    assert stopped_among(vehicles, pair, 0.1)[0] == pytest.approx(share, abs=1e-4)
