"""Rebuild the files of this network: ``python networks/curve/build.py`` (needs the ``networks`` extra)."""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from plain import LANE_M, Drawing, Pen, build  # noqa: E402

LANES = 3
MEDIAN_M = 4.0
# Length of a straight, or radius and turn of a bend, each with its speed limit in m/s.
WAY = (
    ((250.0,), 27.8),
    ((400.0, 60.0), 27.8),
    ((80.0,), 25.0),
    ((200.0, -90.0), 22.2),
    ((60.0,), 19.4),
    ((100.0, 90.0), 15.3),
    ((40.0,), 15.3),
    ((100.0, -90.0), 15.3),
    ((80.0,), 19.4),
    ((150.0, -60.0), 18.0),
    ((250.0,), 25.0),
)


def draw() -> Drawing:
    """Return a road of three lanes each way that winds through bends of 100 to 400 m radius."""
    drawing = Drawing(options=("--default.junctions.radius", "0", "--junctions.limit-turn-speed", "-1"))
    there, back = _edges(drawing, "there", 1.0), _edges(drawing, "back", -1.0)
    drawing.flows = [(tuple(there), 3000.0), (tuple(reversed(back)), 3000.0)]
    return drawing


def _edges(drawing: Drawing, name: str, side: float) -> list[str]:
    """Draw one carriageway, the right one of the median for side 1, the left one for -1; return its edges along x."""
    aside = 0.5 * MEDIAN_M + 0.5 * LANES * LANE_M
    pen = Pen((0.0, -side * aside))
    drawing.node(f"{name}0", pen.at)
    edges = []
    for number, (piece, speed_mps) in enumerate(WAY):
        pen.points = [pen.at]
        if len(piece) == 1:
            pen.straight(piece[0])
        else:
            radius_m, turn_deg = piece
            pen.bend(radius_m + side * aside * (1.0 if turn_deg > 0.0 else -1.0), turn_deg)
        drawing.node(f"{name}{number + 1}", pen.at, more='keepClear="false"')
        ends, shape = (f"{name}{number}", f"{name}{number + 1}"), pen.points
        if side < 0.0:
            ends, shape = (ends[1], ends[0]), shape[::-1]
        edges.append(f"{name}_{number}")
        drawing.edge(edges[-1], ends, shape, LANES, speed_mps, 'spreadType="center"')
    for first, second in pairwise(edges):
        pair = (first, second) if side > 0.0 else (second, first)
        drawing.connect(*pair, [(lane, lane) for lane in range(LANES)])
    return edges


if __name__ == "__main__":
    build(draw(), HERE, "curve")
