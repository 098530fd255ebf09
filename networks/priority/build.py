"""Rebuild the files of this network: ``python networks/priority/build.py`` (needs the ``networks`` extra)."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from plain import Drawing, build  # noqa: E402

ARM_M = 200.0
MAJOR_MPS, MINOR_MPS = 16.7, 13.9
ARMS = {"east": (1.0, 0.0), "north": (0.0, 1.0), "west": (-1.0, 0.0), "south": (0.0, -1.0)}
MAJOR = ("east", "west")
# Buildings stand close to the road, so that who waits sees late who comes.
BLOCKS = (
    ((8.0, 9.0), (34.0, 24.0)), ((42.0, 8.0), (80.0, 20.0)), ((8.0, 32.0), (20.0, 70.0)),
)  # fmt: skip


def draw() -> Drawing:
    """Return a crossing without signals: the road along x has right of way, the one along y gives it."""
    drawing = Drawing()
    drawing.node("crossing", (0.0, 0.0), "priority", 'radius="7"')
    for name, (x, y) in ARMS.items():
        end = ARM_M * x, ARM_M * y
        drawing.node(name, end)
        speed_mps, priority = (MAJOR_MPS, 10) if name in MAJOR else (MINOR_MPS, 1)
        more = f'priority="{priority}"'
        drawing.edge(f"{name}_in", (name, "crossing"), [end, (0.0, 0.0)], 1, speed_mps, more)
        drawing.edge(f"{name}_out", ("crossing", name), [(0.0, 0.0), end], 1, speed_mps, more)
    drawing.blocks_at_corners(BLOCKS)
    arms = list(ARMS)
    for place, name in enumerate(arms):
        flows = (60.0, 330.0, 60.0) if name in MAJOR else (50.0, 70.0, 50.0)
        for turn, flow in zip((1, 2, 3), flows, strict=True):
            drawing.flows.append(((f"{name}_in", f"{arms[(place + turn) % 4]}_out"), flow))
    return drawing


if __name__ == "__main__":
    build(draw(), HERE, "priority")
