"""Draw the pictures of docs/how-to/network.md from the network files: ``python networks/pictures.py [FOLDER]``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import parse

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

HERE = Path(__file__).resolve().parent
NAMES = ("us101", "curve", "interchange", "junction", "priority", "roundabout")
# Where a picture has no use for the whole network, metres along x and y.
WINDOWS = {
    "us101": ((-150.0, 820.0), None),
    "junction": ((-130.0, 130.0), (-130.0, 130.0)),
    "priority": ((-110.0, 110.0), (-110.0, 110.0)),
    "roundabout": ((-90.0, 90.0), (-90.0, 90.0)),
}
SIZES = {"us101": (9.0, 2.2), "curve": (9.0, 3.6), "interchange": (9.0, 3.0)}
ROAD, PATH, BUILDING, LINE = "0.45", "0.55", "#c9b79c", "white"


def draw(name: str, folder: Path) -> None:
    """Draw a network from above: lanes, paths across junctions, driving directions, buildings."""
    root = parse(HERE / name / f"{name}.net.xml").getroot()
    figure, axes = plt.subplots(figsize=SIZES.get(name, (5.0, 5.0)), layout="constrained")
    axes.set_facecolor("#eef0e8")
    polygons = HERE / name / f"{name}.poly.xml"
    for polygon in parse(polygons).getroot().iter("poly") if polygons.is_file() else ():
        axes.fill(*_points(polygon.get("shape", "")).T, facecolor=BUILDING, edgecolor="0.4", linewidth=0.6, zorder=1)
    for edge in root.iter("edge"):
        internal = edge.get("function") == "internal"
        for number, lane in enumerate(edge.iter("lane")):
            line, width_m = _points(lane.get("shape", "")), float(lane.get("width", 3.2))
            if len(line) < 2:
                continue
            left, right = _beside(line, 0.5 * width_m), _beside(line, -0.5 * width_m)
            outline = np.concatenate([left, right[::-1]])
            axes.fill(*outline.T, facecolor=PATH if internal else ROAD, edgecolor="none", zorder=2 + (not internal))
            if not internal:
                for side in (left, right):
                    axes.plot(*side.T, color=LINE, linewidth=0.2 if name in SIZES else 0.6, zorder=4)
                if number == 0 or name not in SIZES:
                    _arrow(axes, line, 30.0 if name in SIZES else 4.0)
    along, across = WINDOWS.get(name, (None, None))
    axes.set_aspect("equal", adjustable="box")
    if along is not None:
        axes.set_xlim(*along)
    if across is not None:
        axes.set_ylim(*across)
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    figure.savefig(folder / f"network-{name}.png", dpi=100, metadata={"Software": None})
    plt.close(figure)


def _points(shape: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([[float(value) for value in point.split(",")[:2]] for point in shape.split()])


def _beside(line: np.ndarray[Any, Any], left_m: float) -> np.ndarray[Any, Any]:
    """Return a line's parallel."""
    steps = np.gradient(line, axis=0)
    steps /= np.maximum(np.hypot(*steps.T), 1e-9)[:, None]
    return line + left_m * np.column_stack([-steps[:, 1], steps[:, 0]])


def _arrow(axes: Any, line: np.ndarray[Any, Any], half_m: float) -> None:  # noqa: ANN401
    """Show the driving direction in a lane's middle."""
    lengths = np.hypot(*np.diff(line, axis=0).T)
    if lengths.sum() < 5.0 * half_m:
        return
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    ends = [0.5 * along[-1] - half_m, 0.5 * along[-1] + half_m]
    x, y = (np.interp(ends, along, line[:, axis]) for axis in (0, 1))
    axes.annotate("", (x[1], y[1]), (x[0], y[0]), zorder=5, annotation_clip=True,
                  arrowprops={"arrowstyle": "->", "color": "white" if half_m < 10.0 else "#0072B2",
                              "linewidth": 0.8, "mutation_scale": 8})  # fmt: skip


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parent / "docs" / "images"
    target.mkdir(parents=True, exist_ok=True)
    for network in NAMES:
        draw(network, target)
