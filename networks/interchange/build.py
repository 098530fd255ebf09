"""Rebuild the files of this network: ``python networks/interchange/build.py`` (needs the ``networks`` extra)."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from plain import LANE_M, Drawing, Pen, Point, build, length_of  # noqa: E402

SPEED_MPS, RAMP_MPS = 27.8, 13.9
# Along the main road: where ramps join and leave, and where it divides. Its left edge is the x axis.
ENTRY_M, WEAVE_M, EXIT_M, MERGE_M, DROP_M, SPLIT_M = 0.0, 350.0, 620.0, 1030.0, 1230.0, 1530.0
# Middle of the lane that ramps lead to and from, and of the lanes beside the left edge of the branch to the right.
AUXILIARY_M = -3.5 * LANE_M


def draw() -> Drawing:
    """Return a road of three lanes that vehicles weave on, join, leave and part from."""
    drawing = Drawing(options=("--default.junctions.radius", "0", "--junctions.limit-turn-speed", "-1"))
    places = (ENTRY_M, WEAVE_M, EXIT_M, MERGE_M, DROP_M, SPLIT_M)
    for name, x in zip(("entry", "weave", "exit", "merge", "drop", "split"), places, strict=True):
        drawing.node(name, (x, 0.0), more='keepClear="false"')
    for name, begin, end, lanes in (
        ("approach", 0, 1, 3), ("weaving", 1, 2, 4), ("between", 2, 3, 3), ("merging", 3, 4, 4), ("after", 4, 5, 3),
    ):  # fmt: skip
        ends = ("entry", "weave", "exit", "merge", "drop", "split")
        shape = [(places[begin], 0.0), (places[end], 0.0)]
        drawing.edge(name, (ends[begin], ends[end]), shape, lanes, SPEED_MPS, 'spreadType="right"')

    north = Pen((WEAVE_M - 140.0, AUXILIARY_M - 200.0), 1.5707963267948966).straight(140.0).bend(60.0, -90.0)
    _ramp(drawing, "loop_on", ("loop_on_entry", "weave"), north.straight(WEAVE_M - north.at[0]).points)
    south = Pen((EXIT_M, AUXILIARY_M)).straight(60.0).bend(80.0, -90.0).straight(120.0)
    _ramp(drawing, "loop_off", ("exit", "loop_off_exit"), south.points)
    slip = Pen((MERGE_M - 200.0, AUXILIARY_M - 26.0), 0.17453292519943295).straight(120.0).bend(280.0, -10.0)
    _ramp(drawing, "slip_on", ("slip_on_entry", "merge"), [*slip.points, (MERGE_M, AUXILIARY_M)])

    left = Pen((SPLIT_M, 0.0)).straight(60.0).bend(400.0, 35.0).straight(150.0)
    drawing.node("left_end", left.at)
    drawing.edge("left", ("split", "left_end"), left.points, 2, SPEED_MPS, 'spreadType="right"')
    right = Pen((SPLIT_M, -LANE_M)).straight(60.0).bend(250.0, -50.0).straight(150.0)
    drawing.node("right_end", right.at)
    length = f'length="{length_of(right.points):.3f}"'
    drawing.edge("right", ("split", "right_end"), right.points, 2, 22.2, f'spreadType="right" {length}')

    drawing.connect("approach", "weaving", [(0, 1), (1, 2), (2, 3)])
    drawing.connect("loop_on", "weaving", [(0, 0)])
    drawing.connect("weaving", "between", [(1, 0), (2, 1), (3, 2)])
    drawing.connect("weaving", "loop_off", [(0, 0)])
    drawing.connect("between", "merging", [(0, 1), (1, 2), (2, 3)])
    drawing.connect("slip_on", "merging", [(0, 0)])
    drawing.connect("merging", "after", [(1, 0), (2, 1), (3, 2)])
    drawing.connect("after", "left", [(1, 0), (2, 1)])
    drawing.connect("after", "right", [(0, 0), (1, 1)])
    drawing.flows = [(route, flow) for route, flow in _flows() if flow]
    return drawing


def _ramp(drawing: Drawing, name: str, ends: tuple[str, str], points: list[Point]) -> None:
    """Draw a ramp; its length is given because netconvert would add the way to the node on the road's left edge."""
    known = {line.split('"')[1] for line in drawing.nodes}
    for end, point in zip(ends, (points[0], points[-1]), strict=True):
        if end not in known:
            drawing.node(end, point)
    more = f'spreadType="center" length="{length_of(points):.3f}"'
    drawing.edge(name, ends, points, 1, 20.0 if name == "slip_on" else RAMP_MPS, more)


def _flows() -> list[tuple[tuple[str, ...], float]]:
    main, weave, later = ("approach", "weaving"), ("loop_on", "weaving"), ("slip_on", "merging", "after")
    on = ("between", "merging", "after")
    return [
        ((*main, *on, "left"), 1500.0),
        ((*main, *on, "right"), 1000.0),
        ((*main, "loop_off"), 400.0),
        ((*weave, *on, "left"), 250.0),
        ((*weave, *on, "right"), 200.0),
        ((*weave, "loop_off"), 50.0),
        ((*later, "left"), 300.0),
        ((*later, "right"), 200.0),
    ]


if __name__ == "__main__":
    build(draw(), HERE, "interchange")
