"""Which car can be the ego of an episode ``gap``: one that a hidden vehicle alone keeps from the lane beside it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from harness.closedloop.beliefs import believed_by_each, ego_of, true_bodies
from harness.closedloop.changing import accepted, lane_middle_m, may_change
from harness.closedloop.sight import hidden_after_sight
from harness.closedloop.traffic import Traffic, with_ego
from harness.config.sensor import SensorSettings
from harness.decisions.belief import Belief
from harness.decisions.drivers.protocol import Driver
from harness.truth.frame import Frame
from mmpf.numerics.arrays import BoolArray, IntArray


class Occupied:
    """The gaps beside some vehicles of the present frame by the truth.

    Attributes:
        traffic: The traffic.
        driver: Whose criterion of gaps it is.
    """

    def __init__(self, traffic: Traffic, driver: Driver, rows: IntArray) -> None:
        """Look at both sides of some rows of the present frame."""
        self.traffic, self.driver = traffic, driver
        self._now, self._rows = traffic.frames[-1], rows
        self._belief: Belief = believed_by_each(self._now, rows, traffic.network.road)
        self._accepts: dict[bool, BoolArray] = {
            to_left: accepted(driver, self._belief, to_left) for to_left in (True, False)
        }

    def by_hidden(self, place: int, settings: SensorSettings) -> tuple[str, int]:
        """Return who occupies a gap beside one of the vehicles and is hidden from it, and the number of that lane.

        Without that vehicle the ego might change, with it it may not; an empty name if there is none.
        """
        now, road = self._now, self.traffic.network.road
        row = int(self._rows[place])
        ego = str(now.vehicle_id[row])
        if not self._belief.leader.gap_m[place] > 0.0:
            return "", 0
        for lane, to_left in self._sides(row):
            if self._accepts[to_left][place]:
                continue
            side = self._belief.left if to_left else self._belief.right
            for body in (int(side.follower.body[place]), int(side.leader.body[place])):
                name = str(now.vehicle_id[body % len(now)])
                if body < 0 or not self._only_for(name, with_ego(now, ego, now.step, self.traffic.step_s), lane):
                    continue
                if hidden_after_sight(tuple(self.traffic.frames), ego, name, road, settings):
                    return name, lane
        return "", 0

    def _sides(self, row: int) -> Iterator[tuple[int, bool]]:
        """Yield the main lanes beside a vehicle's, and whether each is to its left."""
        now, network = self._now, self.traffic.network
        for lane in (int(now.lane[row]) - 1, int(now.lane[row]) + 1):
            off_m = lane_middle_m(network.road, lane, float(now.lon_m[row])) - float(now.lat_m[row])
            if lane in network.ego_lanes and np.isfinite(off_m):
                yield lane, off_m > 0.0

    def _only_for(self, name: str, frame: Frame, lane: int) -> bool:
        """Return whether the ego of a frame might change if a vehicle that is in the way were not there."""
        rest = true_bodies(frame, frame.vehicle_id != name)
        return may_change(self.driver, rest, ego_of(frame), self.traffic.network.road, lane)
