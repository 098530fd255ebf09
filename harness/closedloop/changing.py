"""When the ego changes lanes: where its route needs the lane beside it, as soon as it believes that it may.

It may as long as its driver accepts the gap now and would accept it when the ego's body comes into that lane, everybody
going on as fast as now, and nobody is beside it on the way there. Until its middle is across the line it turns back
where it believes that it may not; from then on it goes through with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from harness.closedloop.beliefs import biased
from harness.decisions.belief import Belief, Beside, Others, believe
from harness.decisions.bodies import Bodies, Egos
from harness.decisions.drivers.protocol import Driver
from harness.scoring.metrics.closedloop import Changed
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray

INTO_LANE_S = 3.0
"""From its first sideways motion until a vehicle's body is in the way of those on the lane beside it."""
BESIDE_M = 1.0
"""Whoever is clear of the ego by less along the road is beside it."""


def lane_middle_m(road: Road, number: int, lon_m: float) -> float:
    """Return the lateral position of a lane's middle, nan where there is no such lane."""
    here = (lane.centre_m for lane in road.lanes if lane.number == number and lane.start_m <= lon_m < lane.end_m)
    return next(here, np.nan)


def accepted(driver: Driver, belief: Belief, to_left: bool) -> BoolArray:
    """Return whether a driver takes the gap beside the ego now and when its body gets there, shape (n,)."""
    takes = np.ones(len(belief), dtype=bool)
    for at in (belief, later(belief, INTO_LANE_S)):
        command = driver.command(at)
        takes &= command.accepts_left if to_left else command.accepts_right
    return takes


def later(belief: Belief, after_s: float) -> Belief:
    """Return the belief after a while in which everybody goes on as fast as now."""
    own = belief.speed_mps

    def ahead(others: Others) -> Others:
        closing = (own if others.gap_m.ndim == 1 else own[:, None]) - others.speed_mps
        return replace(others, gap_m=others.gap_m - after_s * closing)

    def behind(others: Others) -> Others:
        return replace(others, gap_m=others.gap_m - after_s * (others.speed_mps - own))

    def beside(side: Beside) -> Beside:
        return replace(side, leader=ahead(side.leader), follower=behind(side.follower))

    return replace(
        belief,
        leaders=ahead(belief.leaders),
        follower=behind(belief.follower),
        left=beside(belief.left),
        right=beside(belief.right),
    )


def nobody_beside(bodies: Bodies, ego: Egos, shift_m: float) -> bool:
    """Return whether no body is beside the ego within what its own sweeps over, shifted sideways by so much."""
    along = np.abs(bodies.lon_m - ego.lon_m[0]) - 0.5 * (bodies.length_m + ego.length_m[0]) < BESIDE_M
    off = np.sign(shift_m) * (bodies.lat_m - ego.lat_m[0])
    swept = (off > 0.0) & (off < abs(shift_m) + 0.5 * (bodies.width_m + ego.width_m[0]))
    return not bool((along & swept).any())


def may_change(driver: Driver, bodies: Bodies, ego: Egos, road: Road, lane: int, bias_m: float = 0.0) -> bool:
    """Return whether the ego may change to the lane beside it.

    Args:
        driver: Whose criterion of gaps it is.
        bodies: What it takes for real.
        ego: The ego at a single step.
        road: The lanes.
        lane: Number of the lane that it is to go to.
        bias_m: By how much believed gaps ahead are too long.
    """
    shift_m = lane_middle_m(road, lane, float(ego.lon_m[0])) - float(ego.lat_m[0])
    if not np.isfinite(shift_m) or not nobody_beside(bodies, ego, shift_m):
        return False
    belief = biased(believe(bodies, ego, road), bias_m)
    return bool(accepted(driver, belief, to_left=shift_m > 0.0)[0])


@dataclass
class LaneChange:
    """The ego's change of lanes in an episode, from the hand-over on.

    Attributes:
        driver: The driver.
        road: The lanes.
        lane: Number of the lane that the route needs.
        step_s: Time between steps.
        bias_m: By how much believed gaps ahead are too long.
        changing: Whether it is on its way there.
        across_s: When its middle was across the line, since the hand-over; None before.
    """

    driver: Driver
    road: Road
    lane: int
    step_s: float
    bias_m: float = 0.0
    changing: bool = False
    across_s: float | None = None
    _may: list[tuple[bool, bool]] = field(default_factory=list)
    _begins: list[bool] = field(default_factory=list)

    def decide(self, told: Bodies, real: Bodies, ego: Egos) -> float | None:
        """Decide by what is believed, and note what the truth would have it do.

        Args:
            told: What the driver takes for real.
            real: What is.
            ego: The ego at a single step.

        Returns:
            Lateral position that it steers for; None if it does not steer.
        """
        lon_m, own = float(ego.lon_m[0]), int(ego.lane[0])
        aim_m = lane_middle_m(self.road, self.lane, lon_m)
        if self.across_s is None and own == self.lane:
            self.changing, self.across_s = False, round(self.step_s * len(self._may), 6)
        if self.across_s is not None:
            return aim_m
        may, might = (
            may_change(self.driver, bodies, ego, self.road, self.lane, bias_m)
            for bodies, bias_m in ((told, self.bias_m), (real, 0.0))
        )
        self._may.append((may, might))
        if may and not self.changing:
            self._begins.append(might)
        began, self.changing = self.changing, may
        if may:
            return aim_m
        # It goes back where it was on its way, and where it still is off its lane's middle from then.
        return lane_middle_m(self.road, own, lon_m) if began or self._begins else None

    def in_each_lane(self, ego: Egos) -> tuple[Egos, ...]:
        """Return the ego as of its lane, and on its way as of the one beside it too."""
        return (ego, replace(ego, lane=np.full(1, self.lane))) if self.changing else (ego,)

    def changed(self) -> Changed:
        """Return what came of it."""
        may = np.array(self._may, dtype=bool).reshape(-1, 2)
        return Changed(self.across_s, tuple(self._begins), may[:, 0], may[:, 1])
