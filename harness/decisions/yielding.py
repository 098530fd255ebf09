"""A driver that must yield goes if nobody with right of way reaches the conflict point at about the same time.

Times are windows: from when a vehicle's front may come to the place until its rear has left it. Where two windows meet,
or miss each other by less than a margin, the ego holds, and the stop line is a standing leader.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from harness.decisions.belief import NOBODY, Belief, Others
from harness.decisions.bodies import Bodies, Egos
from harness.decisions.crossings import Conflict, Crossing, LaneChain
from harness.decisions.drivers.following import PARAMETERS, SAFE_DECEL_MPS2
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, wrapped
from mmpf.undetected.intensity import Unseen, UnseenOptions

MARGIN_S = 1.0
"""With it who starts at the stop line of ``priority`` waits for cars less than 6.7 to 7.2 s away; the critical headway
of the Highway Capacity Manual (2010, exhibit 19-10) for through traffic of a minor road is 6.5 s."""
FORESIGHT_S, PREDICTED_EVERY_S = 20.0, 0.1
ON_ROUTE_M, ON_ROUTE_RAD = 2.0, np.pi / 4.0
"""Who is on a route has its middle so near to it, and heads along it so nearly, if it is known where it heads."""
UNSEEN_LENGTH_M = UnseenOptions().length_m


@dataclass(frozen=True)
class TimeWindows:
    """From when until when vehicles may be at a place, seconds from now, shape (k,); infinite for never."""

    enter_s: FloatArray
    leave_s: FloatArray


@dataclass(frozen=True)
class EgoPath:
    """The ego's way at one moment: the arc length of its centre, its speed and its length."""

    route: LaneChain
    along_m: float
    speed_mps: float
    length_m: float

    @classmethod
    def of(cls, route: LaneChain, ego: Egos) -> EgoPath:
        """Return where an ego, at a single step, is on its way."""
        along_m = route.line.project(ego.lon_m, ego.lat_m)[0]
        return cls(route, float(along_m[0]), float(ego.speed_mps[0]), float(ego.length_m[0]))

    @property
    def front_m(self) -> float:
        """Arc length of its front."""
        return self.along_m + 0.5 * self.length_m

    def speed_limits(self, along_m: FloatArray) -> FloatArray:
        """Return at which speed it may be at places, so that it is slow enough for bends ahead, shape (k,)."""
        route = self.route
        ahead_m = route.begins_m[:-1] - along_m[:, None]
        slowing = np.sqrt(route.limit_mps**2 + 2.0 * PARAMETERS.comfortable_decel_mps2 * np.maximum(ahead_m, 0.0))
        return np.asarray(np.minimum(_limits(route, along_m), np.where(ahead_m > 0.0, slowing, np.inf).min(axis=1)))

    @cached_property
    def _foreseen(self) -> tuple[FloatArray, FloatArray]:
        """Return predicted times and arc lengths of its front under the intelligent driver model."""
        steps = round(FORESIGHT_S / PREDICTED_EVERY_S)
        along, speed, at = self.along_m, self.speed_mps, [self.along_m]
        ahead_m = np.arange(self.along_m, self.along_m + 400.0)
        limits = self.speed_limits(ahead_m).tolist()
        for _ in range(steps):
            limit = limits[min(int(along - self.along_m), len(limits) - 1)]
            accel = PARAMETERS.max_accel_mps2 * (1.0 - (speed / limit) ** PARAMETERS.exponent)
            speed = max(speed + max(accel, -SAFE_DECEL_MPS2) * PREDICTED_EVERY_S, 0.0)
            along += speed * PREDICTED_EVERY_S
            at.append(along)
        return PREDICTED_EVERY_S * np.arange(steps + 1.0), np.array(at) + 0.5 * self.length_m

    def window(self, place_m: tuple[float, float]) -> tuple[float, float, float]:
        """Return the time interval in which it occupies a place if it goes on, and its speed at the end."""
        times, front = self._foreseen
        enter, leave = (
            float(np.interp(at, front, times, right=np.inf)) for at in (place_m[0], place_m[1] + self.length_m)
        )
        last = min(int(np.searchsorted(front, place_m[1] + self.length_m)), len(front) - 1)
        return enter, leave, float((front[last] - front[last - 1]) / PREDICTED_EVERY_S)


def windows_of(
    place_m: tuple[float, float],
    along_m: FloatArray,
    speed_mps: FloatArray,
    length_m: FloatArray,
    limit_mps: FloatArray,
) -> TimeWindows:
    """Return when vehicles may be at a place of their way, from where to where it goes; arrays of shape (k,).

    They come as early as they can if they speed up to the limit where they are, and leave as late as they do if they go
    on as now.
    """
    to_enter = np.maximum(place_m[0] - 0.5 * length_m - along_m, 0.0)
    to_leave = place_m[1] + 0.5 * length_m - along_m
    gained = np.maximum(limit_mps - speed_mps, 0.0)
    accel = PARAMETERS.max_accel_mps2
    speeding_s, speeding_m = gained / accel, gained * (speed_mps + 0.5 * gained) / accel
    with np.errstate(divide="ignore", invalid="ignore"):
        within = (np.sqrt(speed_mps**2 + 2.0 * accel * to_enter) - speed_mps) / accel
        beyond = speeding_s + (to_enter - speeding_m) / np.maximum(speed_mps, limit_mps)
        leave = np.where(to_leave > 0.0, to_leave / speed_mps, -np.inf)
    enter = np.where(to_leave > 0.0, np.where(to_enter < speeding_m, within, beyond), np.inf)
    return TimeWindows(enter, leave)


def meets(course: EgoPath, conflict: Conflict, windows: TimeWindows, speed_mps: FloatArray) -> BoolArray:
    """Return whose windows meet the ego's, shape (k,).

    Where ways merge, who comes behind the ego must besides be able to slow down to its speed by a braking that a gap
    may ask of it.
    """
    enter_s, leave_s, own_mps = course.window(conflict.own_m)
    closing = np.maximum(speed_mps - own_mps, 0.0) if conflict.merges else np.zeros(len(speed_mps))
    slowing_s = closing**2 / (2.0 * SAFE_DECEL_MPS2 * np.maximum(speed_mps, 1e-9))
    early = windows.enter_s - MARGIN_S - slowing_s < leave_s
    return np.asarray(early & (enter_s < windows.leave_s + MARGIN_S))


def who_conflicts(course: EgoPath, crossing: Crossing, bodies: Bodies) -> BoolArray:
    """Return which bodies the ego must let pass, shape (m,)."""
    found = np.zeros(len(bodies), dtype=bool)
    for conflict in crossing.conflicts:
        on, along_m, speed_mps = on_route(conflict.route, bodies)
        length_m = bodies.length_m[on]
        windows = windows_of(conflict.other_m, along_m, speed_mps, length_m, _limits(conflict.route, along_m))
        found[on] |= meets(course, conflict, windows, speed_mps)
    return found


def on_route(route: LaneChain, bodies: Bodies) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return which bodies are on a way, their arc lengths and their speeds along it, each (k,)."""
    along, across, heading = route.line.project(bodies.lon_m, bodies.lat_m)
    turn = wrapped(bodies.direction_rad - heading)
    along_it = ~np.isfinite(turn) | (np.abs(turn) <= ON_ROUTE_RAD)
    on = np.flatnonzero(
        (np.abs(across) <= ON_ROUTE_M) & along_it & (along >= 0.0) & (along <= route.begins_m[-1] + 5.0)
    )
    share = np.where(np.isfinite(turn[on]), np.cos(turn[on]), 1.0)
    return on, along[on], np.maximum(share * bodies.speed_mps[on], 0.0)


def unseen_in_conflict(course: EgoPath, crossing: Crossing, bodies: Bodies, unseen: Unseen) -> float:
    """Return the probability that an undetected vehicle is one that the ego must let pass.

    Of unseen vehicles, a Poisson field, those count that would be if they drove as fast as their lane allows. They
    overtake nobody: behind a known vehicle none comes before that has left the place.
    """
    cells, counts = unseen.cells, np.zeros(len(unseen.expected), dtype=bool)
    for conflict in crossing.conflicts:
        route = conflict.route
        cell = np.flatnonzero(np.isin(cells.lane, np.add(route.lanes, 1)))
        cell_m = route.line.project(cells.lon_m[cell], cells.lat_m[cell])[0]
        limit_mps = _limits(route, cell_m)
        its = windows_of(conflict.other_m, cell_m, limit_mps, np.full(len(cell), UNSEEN_LENGTH_M), limit_mps)
        on, along_m, speed_mps = on_route(route, bodies)
        known = windows_of(conflict.other_m, along_m, speed_mps, bodies.length_m[on], speed_mps)
        gone_s = np.where(along_m > cell_m[:, None], known.leave_s, -np.inf).max(axis=1, initial=-np.inf)
        counts[cell] |= meets(course, conflict, replace(its, enter_s=np.maximum(its.enter_s, gone_s)), limit_mps)
    return float(-np.expm1(-unseen.expected[counts].sum()))


def room_before(course: EgoPath, places_m: Sequence[float]) -> float | None:
    """Return how far it is to the first of some places before which the ego can stop comfortably; None for none."""
    for place_m in places_m:
        room_m = place_m - course.front_m
        if course.speed_mps**2 <= 2.0 * SAFE_DECEL_MPS2 * room_m:
            return room_m
    return None


def with_standing_leader(belief: Belief, gap_m: float) -> Belief:
    """Return the belief of a single step with a standing leader at a distance."""
    ahead = belief.leaders
    gaps, speeds, body = (
        np.append(of[0], new) for of, new in ((ahead.gap_m, gap_m), (ahead.speed_mps, 0.0), (ahead.body, NOBODY))
    )
    order = np.argsort(gaps, kind="stable")[: ahead.gap_m.shape[1]]
    return replace(belief, leaders=Others(gaps[order][None], speeds[order][None], body[order].astype(np.int64)[None]))


def _limits(route: LaneChain, along_m: FloatArray) -> FloatArray:
    lane = np.clip(np.searchsorted(route.begins_m, along_m, side="right") - 1, 0, len(route.limit_mps) - 1)
    return np.asarray(route.limit_mps[lane])
