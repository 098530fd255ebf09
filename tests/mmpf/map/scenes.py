"""Small lane graphs with known shapes."""

import numpy as np

from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.numerics.arrays import FloatArray


def graph_of(
    lines: dict[str, list[tuple[float, float]] | FloatArray],
    links: list[tuple[str, str]] = (),  # type: ignore[assignment]
    beside: list[tuple[str, str]] = (),  # type: ignore[assignment]
    in_junction: tuple[str, ...] = (),
    width_m: float = 3.2,
    speed_limit_mps: float = 14.0,
) -> LaneGraph:
    """Return a graph of named lines; ``links`` lead from lane to lane, ``beside`` has pairs (right, left)."""
    names = tuple(lines)
    index = {name: k for k, name in enumerate(names)}
    follow = [[index[to] for start, to in links if start == name] for name in names]
    left, right = np.full(len(names), NOWHERE), np.full(len(names), NOWHERE)
    for on_right, on_left in beside:
        left[index[on_right]], right[index[on_left]] = index[on_left], index[on_right]
    return LaneGraph(
        name=names,
        xy=np.concatenate([np.asarray(line, dtype=float) for line in lines.values()]),
        first_point=np.cumsum([0, *(len(line) for line in lines.values())]),
        width_m=np.full(len(names), width_m),
        speed_limit_mps=np.full(len(names), speed_limit_mps),
        left=left,
        right=right,
        successor=np.array([to for each in follow for to in each], dtype=np.int64),
        first_successor=np.cumsum([0, *map(len, follow)]),
        in_junction=np.isin(names, in_junction),
    )


def arc(radius_m: float, turn_rad: float, points: int = 40) -> FloatArray:
    """Return points of an arc that begins at the origin towards east and turns left."""
    angle = np.linspace(0.0, turn_rad, points)
    return radius_m * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=-1)
