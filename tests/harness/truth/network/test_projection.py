"""Where a place lies on the lanes, against distances to every piece of every lane that another library works out."""

from itertools import pairwise

import numpy as np
import pytest
import shapely

from harness.truth.network.network import load_network
from mmpf.map.lane_graph import BESIDE_M, NOWHERE

PLACES = 10_000
WITHIN_M = 0.01
NETS = ("roundabout", "interchange", "curve", "junction")


@pytest.fixture(scope="module", params=NETS)
def scene(request):
    """Return a network's lanes, the same lanes as lines, and places around them, some beyond every lane's edge."""
    graph = load_network(request.param).road.graph
    bounds = graph.first_point
    lines = np.array([shapely.LineString(graph.xy[a:b]) for a, b in pairwise(bounds)])
    rng = np.random.default_rng(13)
    lane = rng.choice(len(graph), size=PLACES, p=graph.length_m / graph.length_m.sum())
    along, left = rng.uniform(0.0, graph.length_m[lane]), rng.uniform(-9.0, 9.0, size=PLACES)
    x, y, _ = graph.place(lane, along, left)
    return graph, lines, x, y


@pytest.mark.slow
def test_the_nearest_lane_and_the_place_on_it_are_those_of_a_search_over_all_lanes(scene):
    graph, lines, x, y = scene
    points = shapely.points(x, y)
    away = np.stack([shapely.distance(line, points) for line in lines])
    beside = away <= (0.5 * graph.width_m + BESIDE_M)[:, None]
    nearest = np.where(beside, away, np.inf).min(axis=0)
    near = graph.lanes_near(x, y)
    found = near.lane[:, 0]
    # At the very edge of what counts as beside a lane the last digit decides.
    edge = np.abs(away - (0.5 * graph.width_m + BESIDE_M)[:, None]).min(axis=0) < 1e-6
    np.testing.assert_array_equal((found == NOWHERE)[~edge], np.isinf(nearest)[~edge])
    on = np.flatnonzero((found != NOWHERE) & ~edge)
    assert len(on) > 0.7 * PLACES
    # Where lanes lie over one another several are equally near, and any of them will do.
    assert np.abs(np.abs(near.left_m[on, 0]) - nearest[on]).max() < WITHIN_M
    assert np.abs(away[found[on], on] - nearest[on]).max() < WITHIN_M
    feet = shapely.line_interpolate_point(lines[found[on]], near.along_m[on, 0])
    assert np.abs(shapely.distance(feet, points[on]) - nearest[on]).max() < WITHIN_M
    listed = near.lane[on] != NOWHERE
    counts = np.minimum(beside[:, on].sum(axis=0), near.lane.shape[1])
    np.testing.assert_array_equal(listed.sum(axis=1), counts)


@pytest.mark.slow
def test_a_place_on_a_given_lane_is_that_of_a_search_over_its_pieces(scene):
    graph, lines, x, y = scene
    points = shapely.points(x, y)
    lane = graph.lanes_near(x, y, most=1).lane[:, 0]
    along, left, _ = graph.on_lane(lane, x, y)
    wanted = shapely.line_locate_point(lines[lane], points)
    # Beyond a lane's ends its last pieces go on, which lines do not.
    inside = (lane != NOWHERE) & (wanted > 0.0) & (wanted < graph.length_m[lane])
    assert inside.sum() > 0.6 * PLACES
    foot = shapely.line_interpolate_point(lines[lane[inside]], along[inside])
    away = shapely.distance(lines[lane[inside]], points[inside])
    assert np.abs(shapely.distance(foot, points[inside]) - away).max() < WITHIN_M
    assert np.abs(np.abs(left[inside]) - away).max() < WITHIN_M
    back_x, back_y, _ = graph.place(lane[inside], along[inside], left[inside])
    away_m = np.hypot(back_x - x[inside], back_y - y[inside])
    # In the wedge outside of a bend the offset is to a corner, and the way back follows one of its sides.
    assert (away_m < WITHIN_M).mean() > 0.9
