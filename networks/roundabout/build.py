"""Rebuild the files of this network: ``python networks/roundabout/build.py`` (needs the ``networks`` extra)."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import numpy as np  # noqa: E402
from plain import LANE_M, Drawing, Point, build  # noqa: E402

RADIUS_M, ARM_M, HALF_ARM_DEG = 26.0, 180.0, 20.0
RING_MPS, ARM_MPS, LANES = 8.3, 13.9, 2
ARMS = ("east", "north", "west", "south")


def draw() -> Drawing:
    """Return a roundabout of two lanes, driven counter-clockwise, with four arms of two lanes each way."""
    drawing = Drawing(options=("--default.junctions.radius", "4"))
    for place, name in enumerate(ARMS):
        middle_deg = 90.0 * place
        leave, join = _on_ring(middle_deg - HALF_ARM_DEG), _on_ring(middle_deg + HALF_ARM_DEG)
        outside = [_turned((x, side * LANE_M), middle_deg) for side in (-1.0, 1.0) for x in (ARM_M, 60.0, 40.0)]
        drawing.node(f"{name}_leave", leave)
        drawing.node(f"{name}_join", join)
        drawing.node(f"{name}_end", outside[0])
        drawing.node(f"{name}_begin", outside[3])
        out_shape = [leave, *outside[2::-1]]
        in_shape = [*outside[3:], join]
        more = 'spreadType="center" priority="1"'
        drawing.edge(f"{name}_out", (f"{name}_leave", f"{name}_end"), out_shape, LANES, ARM_MPS, more)
        drawing.edge(f"{name}_in", (f"{name}_begin", f"{name}_join"), in_shape, LANES, ARM_MPS, more)
        following = ARMS[(place + 1) % 4]
        for edge, ends, from_deg, to_deg in (
            (f"{name}_ring", (f"{name}_leave", f"{name}_join"), middle_deg - HALF_ARM_DEG, middle_deg + HALF_ARM_DEG),
            (f"{name}_next", (f"{name}_join", f"{following}_leave"), middle_deg + HALF_ARM_DEG,
             middle_deg + 90.0 - HALF_ARM_DEG),
        ):  # fmt: skip
            shape = [_on_ring(angle) for angle in np.linspace(from_deg, to_deg, 13)]
            drawing.edge(edge, ends, shape, LANES, RING_MPS, 'spreadType="center" priority="10"')
        drawing.connect(f"{name}_in", f"{name}_next", [(0, 0), (1, 1)])
        drawing.connect(f"{name}_ring", f"{name}_next", [(0, 0), (1, 1)])
        drawing.connect(f"{name}_next", f"{following}_ring", [(0, 0), (1, 1)])
        drawing.connect(f"{name}_next", f"{following}_out", [(0, 0), (1, 1)])
    nodes = " ".join(f"{name}_{end}" for name in ARMS for end in ("leave", "join"))
    edges = " ".join(f"{name}_{part}" for name in ARMS for part in ("ring", "next"))
    drawing.edges.append(f'<roundabout nodes="{nodes}" edges="{edges}"/>')
    for place in range(4):
        for turn, flow in ((1, 110.0), (2, 200.0), (3, 110.0), (4, 20.0)):
            drawing.flows.append((_route(place, turn), flow))
    return drawing


def _route(place: int, turn: int) -> tuple[str, ...]:
    route = [f"{ARMS[place]}_in", f"{ARMS[place]}_next"]
    for passed in range(1, turn):
        name = ARMS[(place + passed) % 4]
        route += [f"{name}_ring", f"{name}_next"]
    return (*route, f"{ARMS[(place + turn) % 4]}_out")


def _on_ring(angle_deg: float) -> Point:
    return _turned((RADIUS_M, 0.0), angle_deg)


def _turned(point: Point, angle_deg: float) -> Point:
    angle = np.deg2rad(angle_deg)
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = point[0] * cosine - point[1] * sine, point[0] * sine + point[1] * cosine
    return round(float(x), 3) + 0.0, round(float(y), 3) + 0.0


if __name__ == "__main__":
    build(draw(), HERE, "roundabout")
