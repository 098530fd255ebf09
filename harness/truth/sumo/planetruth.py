"""Truth from SUMO on networks without one main road: every vehicle around the ego, on whatever edge."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.truth.frame import STEP_S, Frame
from harness.truth.network.lanegraph import PlaneNetwork
from harness.truth.network.network import Network
from harness.truth.sumo.inflow import Inflow
from harness.truth.sumo.planereading import PlaneReader, Snapshot
from harness.truth.sumo.planesmoothing import lead_snapshots, smoothed_frame
from harness.truth.sumo.running import FIRST_VEHICLE_WITHIN_S, RunningSumo
from harness.truth.sumo.session import show_ego, sumo_errors_in_words
from mmpf.map.lane_graph import NOWHERE

# Beyond a lidar's 100 m, so that long vehicles whose middles are out of range but reach into it hide others.
REACH_M = 150.0
BEYOND_RANGE_M = 50.0
NO_EGO = ""
AROUND_M = 100.0
DRIVEN_FOR_S = 3.0
ENOUGH_OTHERS = 5
# Traffic grows until an ego would have so many vehicles around it, or for so long after there could be one.
CROWD, CROWD_WITHIN_S = 10, 300.0
LOOK_EVERY_S = 1.0
# Traffic that is held at a density has so long to reach it.
FILL_WITHIN_S = 300.0
# Of more cars the last to set out are looked at.
MOST_CANDIDATES = 500


class PlaneTruth:
    """Frames of a running SUMO simulation in the plane.

    Attributes:
        road: The road frame.
        step_s: Time between frames.
        expected_steps: How many frames there will be.
        running: The simulation, for those who drive in it themselves.
        has_persons: Whether there may be people on foot.
    """

    def __init__(
        self,
        running: RunningSumo,
        network: Network,
        plane: PlaneNetwork,
        steps: int,
        *,
        ego: bool = True,
        reach_m: float,
        inflow: Inflow | None = None,
    ) -> None:
        """Take over a simulation that has started.

        Args:
            running: The simulation.
            network: The network.
            plane: Its lanes.
            steps: How many frames there will be.
            ego: Whether an ego is chosen.
            reach_m: How far from it vehicles count and hide; without an ego all do.
            inflow: What holds the density; none where the demand is the user's own.
        """
        self.road = network.road
        self.step_s = STEP_S
        self.expected_steps = steps
        self.running, self._sumo = running, running.sumo
        if inflow is not None:
            running.before_step = lambda _: inflow.before_step()
        self._network, self._plane = network, plane
        # The demands of networks in the box have nobody on foot.
        self.has_persons = inflow is None
        self._wants_ego, self._reach_m, self._inflow = ego, reach_m, inflow

    def warm_up(self, duration_s: float) -> None:
        """Let the traffic run without yielding frames, and on until there is a car with others around it.

        Where a density is held the network is filled first.
        """
        for _ in range(round(FILL_WITHIN_S / self.step_s)):
            if self._inflow is None or self._inflow.reached:
                break
            self.running.advance()
        for _ in range(round(duration_s / self.step_s)):
            self.running.advance()
        waited_s, possible_s = 0.0, 0.0
        while waited_s <= FIRST_VEHICLE_WITHIN_S + possible_s and possible_s <= CROWD_WITHIN_S:
            with sumo_errors_in_words(self._sumo):
                snapshot = PlaneReader(self._sumo, self._plane).read()
            if (most := most_around(snapshot)) >= CROWD or (most >= 0 and self._nobody_comes):
                return
            for _ in range(round(LOOK_EVERY_S / self.step_s)):
                self.running.advance()
            waited_s += LOOK_EVERY_S
            possible_s += LOOK_EVERY_S if most >= 0 else 0.0
        if not possible_s:
            raise InputError(
                f"`net`: no car drove on {self._network.name} within {FIRST_VEHICLE_WITHIN_S:g} s; "
                "give routes for passenger vehicles, or a later begin"
            )

    def close(self) -> None:
        """End the simulation; harmless to call twice."""
        self.running.close()

    @property
    def _nobody_comes(self) -> bool:
        """Whether all vehicles that there will ever be are on the road: waiting for more would see them leave."""
        return bool(self._sumo.simulation.getMinExpectedNumber() <= self._sumo.vehicle.getIDCount())

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order; where no car is on the road, time stands still until there is one.

        They end early if the user's own demand runs dry.
        """
        lead = lead_snapshots(self.step_s)
        window: deque[Snapshot] = deque(maxlen=2 * lead + 1)
        reader = PlaneReader(self._sumo, self._plane)
        ego, episode, step, idle_s = NO_EGO, -1, 0, 0.0
        while step < self.expected_steps and idle_s <= FIRST_VEHICLE_WITHIN_S:
            with sumo_errors_in_words(self._sumo):
                window.append(reader.read())
            if len(window) == 2 * lead + 1:
                middle = window[lead]
                if self._wants_ego and ego not in middle.row:
                    ego = choose_plane_ego(middle)
                    if ego != NO_EGO:
                        episode += 1
                        show_ego(self._sumo, ego)
                if self._wants_ego and ego == NO_EGO:
                    idle_s += self.step_s
                else:
                    idle_s = 0.0
                    yield self._frame(window, ego, episode, step)
                    step += 1
            self.running.advance()

    def _frame(self, window: deque[Snapshot], ego: str, episode: int, step: int) -> Frame:
        middle = window[len(window) // 2]
        graph = self._plane.graph
        if not self._wants_ego:
            return smoothed_frame(window, list(middle.row), graph, step, self.step_s, knows_persons=self.has_persons)
        # Smoothing moves nobody so far as the margin.
        names = _names_within(middle, ego, self._reach_m + 10.0)
        frame = smoothed_frame(window, names, graph, step, self.step_s, knows_persons=self.has_persons)
        me = names.index(ego)
        away = np.hypot(frame.lon_m - frame.lon_m[me], frame.lat_m - frame.lat_m[me])
        kept = np.flatnonzero(away <= self._reach_m)
        if self._plane.in_roundabout is not None:
            # Lanes count from 1; what is on none is on no roundabout either.
            on_ring = np.append(False, self._plane.in_roundabout)[frame.lane]
            frame = replace(frame, on_roundabout=on_ring)
        columns: dict[str, Any] = {
            name: values[kept] for name, values in vars(frame).items() if isinstance(values, np.ndarray)
        }
        return replace(frame, **columns, ego=int(np.flatnonzero(kept == me)[0]), episode=episode)


def choose_plane_ego(snapshot: Snapshot) -> str:
    """Return the name of the car that carries the sensor from now on; empty if there is none.

    Of those that have driven for some seconds and have enough others around them it is the last to have set out, since
    it stays longest; failing that the one with most others around it.
    """
    candidates, others = _candidates(snapshot)
    if not len(candidates):
        return NO_EGO
    departure = np.array([snapshot.body[row].departure_s for row in candidates])
    lonely = np.maximum(ENOUGH_OTHERS - others, 0)
    best = candidates[np.lexsort((-departure, lonely))[0]]
    return list(snapshot.row)[int(best)]


def most_around(snapshot: Snapshot) -> int:
    """Return how many others the car that has most has around it; -1 if no car can be the ego."""
    candidates, others = _candidates(snapshot)
    return int(others.max()) if len(candidates) else -1


def _candidates(
    snapshot: Snapshot,
) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Return rows of the cars that may be the ego, and how many others each has around it."""
    rows = [
        row
        for row, (body, lanes) in enumerate(zip(snapshot.body, snapshot.lanes, strict=True))
        if body.is_car and lanes[0] != NOWHERE and snapshot.time_s - body.departure_s >= DRIVEN_FOR_S
    ]
    rows.sort(key=lambda row: -snapshot.body[row].departure_s)
    chosen = np.array(rows[:MOST_CANDIDATES], dtype=np.int64)
    drives = np.array([not body.is_pedestrian for body in snapshot.body], dtype=np.bool_)
    away = np.hypot(
        snapshot.front_x[chosen, None] - snapshot.front_x[drives],
        snapshot.front_y[chosen, None] - snapshot.front_y[drives],
    )
    return chosen, (away <= AROUND_M).sum(axis=1) - 1


def _names_within(snapshot: Snapshot, ego: str, reach_m: float) -> list[str]:
    centres = snapshot.centres()
    away = np.hypot(*(centres - centres[snapshot.row[ego]]).T)
    return [name for name, near in zip(snapshot.row, away <= reach_m, strict=True) if near]
