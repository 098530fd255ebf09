"""Rebuild the files of this network: ``python networks/junction/build.py`` (needs the ``networks`` extra)."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from plain import Drawing, build  # noqa: E402

ARM_M, SPEED_MPS, LANES = 220.0, 13.9, 2
ARMS = {"east": (1.0, 0.0), "north": (0.0, 1.0), "west": (-1.0, 0.0), "south": (0.0, -1.0)}
# Outlines of the buildings on each corner, from the crossing's middle.
BLOCKS = (
    ((13.0, 13.0), (55.0, 40.0)), ((70.0, 13.0), (110.0, 30.0)), ((13.0, 52.0), (32.0, 100.0)),
)  # fmt: skip


def draw() -> Drawing:
    """Return two roads of two lanes each way that cross at signals, with buildings at the corners."""
    drawing = Drawing(options=("--tls.cycle.time", "60", "--tls.left-green.time", "8"))
    drawing.node("crossing", (0.0, 0.0), "traffic_light", 'radius="8"')
    for name, (x, y) in ARMS.items():
        end = ARM_M * x, ARM_M * y
        drawing.node(name, end)
        drawing.edge(f"{name}_in", (name, "crossing"), [end, (0.0, 0.0)], LANES, SPEED_MPS)
        drawing.edge(f"{name}_out", ("crossing", name), [(0.0, 0.0), end], LANES, SPEED_MPS)
    drawing.blocks_at_corners(BLOCKS)
    arms = list(ARMS)
    for place, name in enumerate(arms):
        for turn, flow in ((1, 110.0), (2, 360.0), (3, 110.0)):
            drawing.flows.append(((f"{name}_in", f"{arms[(place + turn) % 4]}_out"), flow))
    return drawing


if __name__ == "__main__":
    build(draw(), HERE, "junction")
