"""What a driver decides by: the vehicles ahead in its lane, and those ahead and behind in adjacent lanes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from harness.decisions.bodies import Bodies, Egos
from harness.decisions.views import HORIZON_M, LaneView, lane_views
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

LEADERS = 3
"""How many vehicles ahead a belief holds."""
NOBODY = -1
# Bodies that overlap across the road by less than the rest of this share pass each other.
IN_THE_WAY = 0.85


@dataclass(frozen=True)
class Others:
    """Vehicles in one place of the ego's surroundings at each of n steps, arrays of shape (n,) or (n, k).

    Attributes:
        gap_m: Clear distance bumper to bumper, less the bodies of those in between; infinite where there is nobody.
        speed_mps: Speed along the lane, 0 where there is nobody.
        body: Which of the bodies it is, ``NOBODY`` where there is none.
    """

    gap_m: FloatArray
    speed_mps: FloatArray
    body: IntArray

    @property
    def exists(self) -> BoolArray:
        """Whether there is a vehicle."""
        return np.asarray(np.isfinite(self.gap_m))

    def at(self, place: int) -> Others:
        """Return those at one of k places, arrays of shape (n,)."""
        return Others(self.gap_m[:, place], self.speed_mps[:, place], self.body[:, place])


@dataclass(frozen=True)
class Beside:
    """A lane beside the ego's at each of n steps.

    Attributes:
        exists: Whether there is one, shape (n,).
        leader: The nearest vehicle ahead on it.
        follower: The nearest behind.
    """

    exists: BoolArray
    leader: Others
    follower: Others


@dataclass(frozen=True)
class Belief:
    """What a driver believes at each of n steps.

    Attributes:
        speed_mps: The ego's speed, shape (n,).
        length_m: The ego's length, shape (n,).
        speed_limit_mps: Speed limit, nan where none is known, shape (n,).
        leaders: Vehicles ahead in the ego's lane, the nearest first, shape (n, 3).
        follower: The nearest behind in it.
        left: The lane to the left.
        right: The lane to the right.
    """

    speed_mps: FloatArray
    length_m: FloatArray
    speed_limit_mps: FloatArray
    leaders: Others
    follower: Others
    left: Beside
    right: Beside

    def __len__(self) -> int:
        return len(self.speed_mps)

    @property
    def leader(self) -> Others:
        """The nearest vehicle ahead in the ego's lane, arrays of shape (n,)."""
        return self.leaders.at(0)

    def without(self, place: int) -> Belief:
        """Return the belief without the vehicle at one place ahead; those beyond stay where they are."""
        gap_m, body = self.leaders.gap_m.copy(), self.leaders.body.copy()
        gap_m[:, place], body[:, place] = np.inf, NOBODY
        return replace(self, leaders=replace(self.leaders, gap_m=gap_m, body=body))


def believe(bodies: Bodies, egos: Egos, road: Road) -> Belief:
    """Return the belief that bodies on the road amount to.

    In the ego's lane counts who has its centre between the lines, or its body in the way of the ego's.
    """
    own, left, right = lane_views(road, egos, bodies)
    at = bodies.step
    between = np.abs(own.across_m) <= own.half_width_m[at]
    in_the_way = np.abs(own.across_m - own.ego_across_m[at]) < IN_THE_WAY * 0.5 * (egos.width_m[at] + bodies.width_m)
    in_lane = own.exists[at] & (between | in_the_way)
    return Belief(
        speed_mps=egos.speed_mps,
        length_m=egos.length_m,
        speed_limit_mps=road.speed_limit_of(egos.lane),
        leaders=_nearest(own, in_lane, egos, bodies, LEADERS),
        follower=_nearest(own, in_lane, egos, bodies, 1, ahead=False).at(0),
        left=_beside(left, egos, bodies),
        right=_beside(right, egos, bodies),
    )


def _beside(view: LaneView, egos: Egos, bodies: Bodies) -> Beside:
    at = bodies.step
    in_lane = view.exists[at] & (np.abs(view.across_m) <= view.half_width_m[at])
    sides = (_nearest(view, in_lane, egos, bodies, 1, ahead).at(0) for ahead in (True, False))
    return Beside(view.exists, *sides)


def _nearest(view: LaneView, in_lane: BoolArray, egos: Egos, bodies: Bodies, count: int, ahead: bool = True) -> Others:
    """Return the nearest bodies of a lane ahead or behind, arrays of shape (n, count)."""
    away = view.along_m if ahead else -view.along_m
    with np.errstate(invalid="ignore"):
        chosen = np.flatnonzero(in_lane & (away > 0.0) & (away <= HORIZON_M))
    chosen = chosen[np.lexsort((away[chosen], bodies.step[chosen]))]
    step = bodies.step[chosen]
    place = np.arange(len(chosen)) - np.searchsorted(step, step)
    chosen, step, place = (column[place < count] for column in (chosen, step, place))
    shape = len(egos), count
    body, gap, speed = np.full(shape, NOBODY), np.full(shape, np.inf), np.zeros(shape)
    body[step, place] = chosen
    speed[step, place] = view.speed_mps[chosen]
    centre, length = np.full(shape, np.inf), np.zeros(shape)
    centre[step, place], length[step, place] = away[chosen], bodies.length_m[chosen]
    before, before_length = np.zeros(len(egos)), egos.length_m
    total = np.zeros(len(egos))
    for rank in range(count):
        with np.errstate(invalid="ignore"):
            clear = centre[:, rank] - before - 0.5 * (before_length + length[:, rank])
        # Two tracks on one vehicle leave no room between them, and none behind the first.
        total = total + (clear if rank == 0 else np.maximum(clear, 0.0))
        gap[:, rank] = np.where(np.isfinite(centre[:, rank]), total, np.inf)
        before, before_length = centre[:, rank], length[:, rank]
    return Others(gap, speed, body)
