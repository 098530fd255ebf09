"""How the ego passes places where it must yield, and what the outcome was."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from harness.decisions.belief import Belief
from harness.decisions.bodies import Bodies
from harness.decisions.crossings import Crossing, LaneChain, crossings_of
from harness.decisions.yielding import EgoPath, room_before, unseen_in_conflict, who_conflicts, with_standing_leader
from harness.scoring.driving.encroachment import Encounter, TimedPath, encounter
from harness.scoring.metrics.closedloop import HARD_BRAKE_MPS2, Contact, Crossed
from harness.truth.frame import Frame
from mmpf.map.lane_graph import LaneGraph
from mmpf.undetected.intensity import Unseen

WAITS_MPS = 1.0
"""Whoever is slower before a place of conflict waits."""


@dataclass
class Passage:
    """The ego's way over places where it must yield, the nearest first, in an episode.

    ``heed`` is the probability of an unseen vehicle in its way from which on the ego holds; None for never.
    """

    route: LaneChain
    crossings: tuple[Crossing, ...]
    step_s: float
    heed: float | None = None
    _frames: list[Frame] = field(default_factory=list)
    _holds: list[tuple[bool, bool]] = field(default_factory=list)
    _had_way: set[str] = field(default_factory=set)
    _entered_s: float | None = None
    _left_s: float | None = None
    _waited: int = 0

    @classmethod
    def over(cls, graph: LaneGraph, lanes: tuple[int, ...], step_s: float, heed: float | None = None) -> Passage:
        """Return the passage over some lanes."""
        route = LaneChain.of(graph, lanes)
        return cls(route, crossings_of(graph, route), step_s, heed)

    def room_m(self, course: EgoPath, bodies: Bodies, unseen: Unseen | None = None) -> float | None:
        """Return how far ahead the ego must stop, by its belief; None where it may go.

        For a vehicle that it knows of it holds at the stop line, or past that before the place of conflict. For one
        that nobody has seen it goes up to there, since it sees more from there.
        """
        crossing = next((each for each in self.crossings if course.front_m < each.begins_m), None)
        if crossing is None:
            return None
        if who_conflicts(course, crossing, bodies).any():
            return room_before(course, (crossing.stop_m, crossing.begins_m))
        if self.heed is None or unseen is None or unseen_in_conflict(course, crossing, bodies, unseen) <= self.heed:
            return None
        return room_before(course, (crossing.begins_m,))

    def with_stops(self, belief: Belief, course: EgoPath, room_m: float | None) -> Belief:
        """Return what the driver decides by: it slows down for bends, and somebody stands where it is to hold."""
        belief = replace(belief, speed_limit_mps=course.speed_limits(np.array([course.along_m])))
        return belief if room_m is None else with_standing_leader(belief, room_m)

    def note(self, frame: Frame, course: EgoPath, real: Bodies, holds: bool, must_hold: bool) -> None:
        """Note a step's truth, where the ego is, and whether it holds by what it believes, and would by the truth."""
        if not self.crossings:
            return
        time_s, first = round(len(self._frames) * self.step_s, 6), self.crossings[0]
        self._frames.append(frame)
        others = np.delete(frame.vehicle_id, frame.ego)
        self._had_way |= set(others[who_conflicts(course, first, real)].tolist())
        if self._entered_s is None and course.front_m >= first.begins_m:
            self._entered_s = time_s
        if self._left_s is None and course.front_m - course.length_m > first.ends_m:
            self._left_s = time_s
        if self._entered_s is None:
            self._holds.append((holds, must_hold))
            self._waited += course.speed_mps < WAITS_MPS

    def crossed(self, provoked: str, contact: Contact | None) -> Crossed:
        """Return the outcome of the first crossing.

        Args:
            provoked: The vehicle that the episode provokes; empty for none.
            contact: The ego's collision; None for none.
        """
        holds = np.array(self._holds, dtype=bool).reshape(-1, 2)
        names = self._had_way | ({provoked} - {""})
        met = {name: found for name in sorted(names) if (found := self._encounter(name)) is not None}
        times = [found.time_s for found in met.values()]
        if contact is not None and contact.vehicle_id in names:
            times.append(0.0)
        return Crossed(
            entered_s=self._entered_s,
            left_s=self._left_s,
            waited_s=round(self._waited * self.step_s, 6),
            holds=holds[:, 0],
            must_hold=holds[:, 1],
            encroachment_s=min(times, default=None),
            yielded=self._yielded(met.get(provoked)) if provoked else None,
            made_brake=any(self._braked_hard(name) for name in names),
        )

    def _yielded(self, met: Encounter | None) -> bool | None:
        """Return whether the ego let the vehicle pass that it met, or has waited until the end."""
        if self._entered_s is None:
            return True
        return None if met is None else not met.own_first

    def _braked_hard(self, name: str) -> bool:
        """Return whether a vehicle braked hard while the ego was at the place."""
        if self._entered_s is None:
            return False
        last = len(self._frames) if self._left_s is None else round(self._left_s / self.step_s) + 1
        during = self._frames[round(self._entered_s / self.step_s) : last]
        speed = [float(its) for frame in during for its in frame.speed_mps[frame.vehicle_id == name]]
        return bool((np.diff(speed) < HARD_BRAKE_MPS2 * self.step_s).any())

    def _encounter(self, name: str) -> Encounter | None:
        """Return how the ego and another met where their paths cross; None where they did not."""
        own = [(frame, frame.ego) for frame in self._frames]
        its = [(frame, int(row)) for frame in self._frames for row in np.flatnonzero(frame.vehicle_id == name)]
        return encounter(*_path(own), *_path(its)) if its else None


def _path(places: list[tuple[Frame, int]]) -> tuple[TimedPath, tuple[float, float]]:
    """Return a vehicle's path, and its length and width."""
    x, y, time_s = np.array([(frame.lon_m[row], frame.lat_m[row], frame.time_s) for frame, row in places]).T
    frame, row = places[0]
    return TimedPath(x, y, time_s), (float(frame.length_m[row]), float(frame.width_m[row]))
