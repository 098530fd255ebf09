"""Lanes of a graph as an area: uniform samples over it, and how much of it is in range.

Paths across a junction lie over one another. What several lanes cover is one piece of ground and counts once.
"""

import numpy as np

from mmpf.map.lane_graph import LaneGraph
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

# As many lanes as can lie over one another in a large junction.
MOST_OVER_ONE_ANOTHER = 24
# The mean over the map is taken at so many places, over pieces of road of this length or of so many in all.
PLACES = 200
PIECE_M, MOST_PIECES = 4.0, 100_000


def lanes_over(graph: LaneGraph, x: FloatArray, y: FloatArray) -> IntArray:
    """Return how many lanes cover each place, shape (n,); places in metres, each (n,)."""
    near = graph.lanes_near(x, y, most=MOST_OVER_ONE_ANOTHER)
    # Beyond a lane's end the distance to it is more than the offset to the left could be.
    covers = (near.lane >= 0) & (np.abs(near.left_m) <= 0.5 * graph.width_m[near.lane])
    return np.asarray(covers.sum(axis=1))


def drawn_on_lanes(
    graph: LaneGraph, pieces: IntArray, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Draw places on pieces of lanes, and whether each is to be kept, so that those kept are even over the ground.

    Args:
        graph: The lanes.
        pieces: Indices into the graph's segments, of which one at least.
        count: How many to draw.
        rng: Source of randomness.

    Returns:
        x and y, metres, the direction of the lane there, and whether the place is kept; each of shape (count,).
    """
    segments = graph.segments
    area = segments.length_m[pieces] * graph.width_m[segments.lane[pieces]]
    piece = rng.choice(pieces, size=count, p=area / area.sum())
    along = rng.uniform(0.0, 1.0, size=count) * segments.length_m[piece]
    across = rng.uniform(-0.5, 0.5, size=count) * graph.width_m[segments.lane[piece]]
    cosine, sine = segments.cosine[piece], segments.sine[piece]
    x = segments.start_x[piece] + along * cosine - across * sine
    y = segments.start_y[piece] + along * sine + across * cosine
    kept = rng.uniform(size=count) * np.maximum(lanes_over(graph, x, y), 1) < 1.0
    return x, y, np.arctan2(sine, cosine), kept


def pieces_within(graph: LaneGraph, x: float, y: float, range_m: float) -> IntArray:
    """Return the segments of the graph that may have a place within a distance of one."""
    segments = graph.segments
    half = 0.5 * segments.length_m
    away = np.hypot(segments.start_x + half * segments.cosine - x, segments.start_y + half * segments.sine - y)
    return np.flatnonzero(away <= range_m + half + 0.5 * graph.width_m[segments.lane])


def mean_lane_area_m2(graph: LaneGraph, range_m: float) -> float:
    """Return how much of the lanes' ground is within a distance of a place on a lane, on the average over the map."""
    segments = graph.segments
    piece_m = max(PIECE_M, float(segments.length_m.sum()) / MOST_PIECES)
    count = np.maximum(1, np.ceil(segments.length_m / piece_m)).astype(np.int64)
    of = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[of]
    along = share * segments.length_m[of]
    x = segments.start_x[of] + along * segments.cosine[of]
    y = segments.start_y[of] + along * segments.sine[of]
    width = graph.width_m[segments.lane[of]]
    area = np.zeros(len(of))
    for aside in (-0.25, 0.25):
        over = lanes_over(graph, x - aside * width * segments.sine[of], y + aside * width * segments.cosine[of])
        area += 0.5 * width * segments.length_m[of] / count[of] / np.maximum(over, 1)
    places = np.unique(np.linspace(0, len(of) - 1, PLACES).astype(np.int64))
    within = [area[np.hypot(x - x[k], y - y[k]) <= range_m].sum() for k in places]
    return float(np.mean(within))
