"""A T-crossing as a CommonRoad scenario: two lanes eastwards, one westwards, and a stem to the south."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

WIDTH_M, BOX_M, ARM_M = 3.5, 10.0, 60.0
EAST, WEST, NORTH, SOUTH = 0.0, np.pi, 0.5 * np.pi, -0.5 * np.pi
# Middle lines from where to where, and in which direction at either end.
MIDDLES = {
    "w_in_left": ((-ARM_M, -1.75, EAST), (-BOX_M, -1.75, EAST)),
    "w_in_right": ((-ARM_M, -5.25, EAST), (-BOX_M, -5.25, EAST)),
    "w_out": ((-BOX_M, 1.75, WEST), (-ARM_M, 1.75, WEST)),
    "e_in": ((ARM_M, 1.75, WEST), (BOX_M, 1.75, WEST)),
    "e_out": ((BOX_M, -1.75, EAST), (ARM_M, -1.75, EAST)),
    "s_in": ((1.75, -ARM_M, NORTH), (1.75, -BOX_M, NORTH)),
    "s_out": ((-1.75, -BOX_M, SOUTH), (-1.75, -ARM_M, SOUTH)),
    "w to e": ((-BOX_M, -1.75, EAST), (BOX_M, -1.75, EAST)),
    "w to s": ((-BOX_M, -5.25, EAST), (-1.75, -BOX_M, SOUTH)),
    "e to w": ((BOX_M, 1.75, WEST), (-BOX_M, 1.75, WEST)),
    "e to s": ((BOX_M, 1.75, WEST), (-1.75, -BOX_M, SOUTH)),
    "s to e": ((1.75, -BOX_M, NORTH), (BOX_M, -1.75, EAST)),
    "s to w": ((1.75, -BOX_M, NORTH), (-BOX_M, 1.75, WEST)),
}
ENTRY = {"w to e": "w_in_left", "w to s": "w_in_right"}
ENTRY |= {"e to w": "e_in", "e to s": "e_in", "s to e": "s_in", "s to w": "s_in"}
FOLLOW = {
    **{lane: tuple(path for path, entry in ENTRY.items() if entry == lane) for lane in set(ENTRY.values())},
    **{path: (f"{path[-1]}_out",) for path in ENTRY},
}
BESIDE = {
    "w_in_left": ("left", "w_out", "opposite", "right", "w_in_right", "same"),
    "w_in_right": ("left", "w_in_left", "same"),
    "w_out": ("left", "w_in_left", "opposite"),
}
LIMIT_MPS = {"e_in": 13.9, "s_in": 8.3}
NUMBER = {name: 100 + k for k, name in enumerate(MIDDLES)}
STEP_S = 0.1


@dataclass(frozen=True)
class Driver:
    """A car that drives along a way of lanes at constant speed."""

    name: int
    way: tuple[str, ...]
    from_m: float
    speed_mps: float
    length_m: float = 4.5

    def pose_at(self, time_s: float) -> tuple[float, float, float]:
        """Return x, y and heading of its middle."""
        points = np.concatenate([middle(lane) for lane in self.way])
        points = points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > 1e-6)]
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        heading = np.unwrap(np.arctan2(*np.gradient(points, along, axis=0).T[::-1]))
        at = self.from_m + self.speed_mps * time_s
        x, y, turned = (float(np.interp(at, along, values)) for values in (*points.T, heading))
        return x, y, turned


LEFT_TURNER = Driver(1, ("e_in", "e to s", "s_out"), 30.0, 8.0)
STRAIGHT_ON = Driver(2, ("w_in_left", "w to e", "e_out"), 10.0, 12.0)
ONCOMING = Driver(3, ("e_in", "e to w", "w_out"), 5.0, 11.0)
FROM_STEM = Driver(4, ("s_in", "s to e", "e_out"), 40.0, 6.0)
DRIVERS = (LEFT_TURNER, STRAIGHT_ON, ONCOMING, FROM_STEM)


def middle(name: str) -> np.ndarray:
    """Return a lane's middle line, a cubic that leads as its ends do, shape (41, 2)."""
    (x0, y0, h0), (x1, y1, h1) = MIDDLES[name]
    share = np.linspace(0.0, 1.0, 41)[:, None]
    pull = 1.2 * np.hypot(x1 - x0, y1 - y0) if h0 != h1 else np.hypot(x1 - x0, y1 - y0)
    start, end = np.array([x0, y0]), np.array([x1, y1])
    out, into = pull * np.array([np.cos(h0), np.sin(h0)]), pull * np.array([np.cos(h1), np.sin(h1)])
    return (
        (2 * share**3 - 3 * share**2 + 1) * start
        + (share**3 - 2 * share**2 + share) * out
        + (3 * share**2 - 2 * share**3) * end
        + (share**3 - share**2) * into
    )


def write_crossing(
    path: Path,
    drivers: tuple[Driver, ...] = DRIVERS,
    step_s: float = STEP_S,
    shift: tuple[float, float] = (0.0, 0.0),
    in_lanelet: dict[str, str] | None = None,
    extra: str = "",
    seconds: float = 5.0,
) -> Path:
    """Write the scenario; ``in_lanelet`` adds elements to lanelets, ``extra`` to the file."""
    parts = [f'<commonRoad commonRoadVersion="2020a" timeStepSize="{step_s}" benchmarkID="T">']
    parts += [_lanelet(name, shift, (in_lanelet or {}).get(name, "")) for name in MIDDLES]
    for driver in drivers:
        states = [_state(driver, tick, tick * step_s, shift) for tick in range(round(seconds / step_s) + 1)]
        parts.append(
            f'<dynamicObstacle id="{driver.name}"><type>car</type><shape><rectangle><length>{driver.length_m}</length>'
            f"<width>1.8</width></rectangle></shape><initialState>{states[0]}</initialState>"
            f"<trajectory>{''.join(f'<state>{state}</state>' for state in states[1:])}</trajectory></dynamicObstacle>"
        )
    path.write_text("\n".join([*parts, extra, "</commonRoad>"]), encoding="utf-8")
    return path


def _lanelet(name: str, shift: tuple[float, float], more: str) -> str:
    line = middle(name)
    ahead = np.gradient(line, axis=0)
    aside = 0.5 * WIDTH_M * np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1) / np.hypot(*ahead.T)[:, None]
    bounds = ""
    for tag, sign in (("leftBound", 1.0), ("rightBound", -1.0)):
        points = (f"<point><x>{x:.6f}</x><y>{y:.6f}</y></point>" for x, y in line + sign * aside + shift)
        bounds += f"<{tag}>{''.join(points)}</{tag}>"
    successors = "".join(f'<successor ref="{NUMBER[to]}"/>' for to in FOLLOW.get(name, ()))
    beside = iter(BESIDE.get(name, ()))
    adjacent = "".join(
        f'<adjacent{side.title()} ref="{NUMBER[other]}" drivingDir="{way}"/>'
        for side, other, way in zip(beside, beside, beside, strict=True)
    )
    limit = f"<speedLimit>{LIMIT_MPS[name]}</speedLimit>" if name in LIMIT_MPS else ""
    return f'<lanelet id="{NUMBER[name]}">{bounds}{successors}{adjacent}{limit}{more}</lanelet>'


def _state(driver: Driver, tick: int, time_s: float, shift: tuple[float, float]) -> str:
    x, y, heading = driver.pose_at(time_s)
    return (
        f"<position><point><x>{x + shift[0]:.6f}</x><y>{y + shift[1]:.6f}</y></point></position>"
        f"<orientation><exact>{heading:.9f}</exact></orientation><time><exact>{tick}</exact></time>"
        f"<velocity><exact>{driver.speed_mps}</exact></velocity>"
    )
