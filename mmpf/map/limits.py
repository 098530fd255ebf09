"""Bounds on the size of a lane graph: it comes from external files, and its square matrices must fit in memory."""

from __future__ import annotations

import numpy as np

from mmpf.map.lane_graph import BESIDE_M, CELL_M, LaneGraph

MOST_POINTS = 2_000_000
MOST_ENTRIES = 50_000_000
FARTHEST_M = 1e8


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
