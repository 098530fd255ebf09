from dataclasses import replace

import numpy as np
import pytest

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.map.lane_graph import LaneGraph
from mmpf.motion.state import LAT, LON
from mmpf.surroundings.reported_route import on_heaviest_way
from tests.mmpf.map.scenes import graph_of
from tests.mmpf.scenes import belief_of

GRAPH = graph_of(
    {"in": [(0, 0), (50, 0)], "on": [(50, 0), (100, 0)], "off": [(50, 0), (50, -50)], "far": [(50, -50), (90, -50)]},
    [("in", "on"), ("in", "off"), ("off", "far")],
)


def belief(places: list[tuple[str, float, float]], graph: LaneGraph = GRAPH) -> Mixture:
    """One component of particles (lane, arc length, weight)."""
    lane = np.array([graph.name.index(name) for name, _, _ in places])
    state, zeros = np.zeros((6, len(lane))), np.zeros(len(lane))
    state[LON], state[LAT], heading = graph.place(lane, np.array([s for _, s, _ in places]), zeros)
    mixture = belief_of([state], [np.array([w for _, _, w in places])])
    latents = np.stack([lane.astype(float), zeros - 1.0, heading])
    return replace(mixture, cloud=replace(mixture.cloud, latents=latents), has_headings=True)


def test_of_two_ways_the_heavier_is_reported_and_not_the_place_between_them() -> None:
    split = belief([("on", 20, 0.35), ("off", 20, 0.25), ("off", 22, 0.4)])
    mean = component_moments(on_heaviest_way(split, GRAPH)).mean[:, 0]
    assert (mean[LON], mean[LAT]) == (pytest.approx(50.0), pytest.approx(-(20 * 0.25 + 22 * 0.4) / 0.65))


def test_lanes_that_lead_to_the_heaviest_one_or_from_it_count_with_it() -> None:
    split = belief([("in", 45, 0.3), ("off", 2, 0.4), ("on", 2, 0.2), ("far", 1, 0.1)])
    kept = np.exp(on_heaviest_way(split, GRAPH).cloud.log_weight)
    assert kept == pytest.approx(np.array([0.3, 0.4, 0.0, 0.1]) / 0.8)


def test_what_is_on_one_way_stays_as_it_is() -> None:
    single = belief([("in", 45, 0.3), ("in", 48, 0.7)])
    assert on_heaviest_way(single, GRAPH) is single


def test_each_component_has_a_way_of_its_own() -> None:
    one, other = belief([("on", 20, 0.6), ("off", 20, 0.4)]), belief([("on", 30, 0.2), ("off", 30, 0.8)])
    joined = one.keep_and_join(np.array([True]), other.cloud, replace(other.components, track_id=np.array([2])))
    mean = component_moments(on_heaviest_way(joined, GRAPH)).mean
    assert mean[LON] == pytest.approx([70.0, 50.0])
    assert mean[LAT] == pytest.approx([0.0, -30.0])
