"""Bounds on lanes from external files: one can drive on them, and a graph's square matrices fit in memory."""

from collections.abc import Sequence

import numpy as np

from mmpf.map.lane_graph import BESIDE_M, CELL_M, LaneGraph
from mmpf.map.road import Lane

MOST_POINTS = 2_000_000
MOST_ENTRIES = 50_000_000
FARTHEST_M = 1e8
MOST_LANES, NARROWEST_LANE_M = 1000, 0.5


def lanes_problem(lanes: Sequence[Lane]) -> str:
    """Return in words why nobody can drive on the lanes of a road; empty if one can."""
    if not 1 <= len(lanes) <= MOST_LANES:
        return f"it has {len(lanes)} lanes"
    for lane in lanes:
        wide = lane.left_m - lane.right_m >= NARROWEST_LANE_M
        within = wide and lane.right_m >= -FARTHEST_M and lane.left_m <= FARTHEST_M and lane.start_m < lane.end_m
        if not within or not isinstance(lane.number, int):
            return f"lane {lane.number} has no width or length"
    return ""


def graph_problem(graph: LaneGraph) -> str:
    """Return in words what makes a graph too large; empty if nothing does."""
    if len(graph.xy) > MOST_POINTS:
        return f"its lanes have {len(graph.xy)} points, more than {MOST_POINTS}"
    if np.abs(graph.xy).max() > FARTHEST_M or not np.isfinite(graph.speed_limit_mps).all():
        return f"a lane is beyond {FARTHEST_M:g} m, or has no finite speed limit"
    reach = graph.width_m[graph.segments.lane] + 2.0 * BESIDE_M
    span_x = graph.segments.length_m * np.abs(graph.segments.cosine) + reach
    span_y = graph.segments.length_m * np.abs(graph.segments.sine) + reach
    if ((span_x / CELL_M + 2.0) * (span_y / CELL_M + 2.0)).sum() > MOST_ENTRIES:
        return "its lanes are too many, too long or too wide"
    return ""
