"""Traffic in the plane on any edge: warm-up, smoothing, and the view from an ego among it.

Positions are averaged over half a second to either side, and speeds are their change.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.truth.frame import STEP_S, Frame
from harness.truth.network.lanegraph import PlaneNetwork
from harness.truth.network.network import Network
from harness.truth.sumo.inflow import Inflow
from harness.truth.sumo.plane_reading import PlaneReader, PlaneReading
from harness.truth.sumo.reading import NO_EGO_INDEX, classes_of
from harness.truth.sumo.session import FIRST_VEHICLE_WITHIN_S, RunningSumo
from harness.truth.sumo.smoothing import LEAD_FRAMES, hann_weights, rounded
from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.numerics.arrays import FloatArray, IntArray

# Beyond a lidar's 100 m, so that long vehicles whose middles are out of range but reach into it hide others.
REACH_M = 150.0
BEYOND_RANGE_M = 50.0
# Smoothing moves nobody so far.
MARGIN_M = 10.0
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


class PlaneTraffic:
    """Traffic of a network in the plane; see ``harness.truth.sumo.simulation.RoadTraffic``."""

    # One more than is averaged, for the speeds.
    lead = LEAD_FRAMES + 1
    waits_s = FIRST_VEHICLE_WITHIN_S
    # Headings go round, and those of a rolling axle are smooth already.
    jumpy: tuple[str, ...] = ("accel_mps2",)

    def __init__(
        self, running: RunningSumo, network: Network, plane: PlaneNetwork, reach_m: float, inflow: Inflow | None
    ) -> None:
        """Take over a simulation; vehicles farther than ``reach_m`` from an ego neither count nor hide."""
        self._running, self._network, self._plane = running, network, plane
        self._reach_m, self._inflow = reach_m, inflow
        self._reader = PlaneReader(running.sumo, plane)
        if inflow is not None:
            running.before_step = inflow.before_step

    def fill(self) -> None:
        """Go on until a density that is held is reached."""
        for _ in range(round(FILL_WITHIN_S / STEP_S)):
            if self._inflow is None or self._inflow.reached:
                return
            self._running.advance()

    def wait(self) -> None:
        """Go on until there is a car with others around it, or no one else will ever come."""
        sumo, waited_s, possible_s = self._running.sumo, 0.0, 0.0
        while waited_s <= FIRST_VEHICLE_WITHIN_S + possible_s and possible_s <= CROWD_WITHIN_S:
            others = _candidates(PlaneReader(sumo, self._plane).read())[1]
            nobody_comes = sumo.simulation.getMinExpectedNumber() <= sumo.vehicle.getIDCount()
            if others.max(initial=-1) >= CROWD or (len(others) and nobody_comes):
                return
            for _ in range(round(LOOK_EVERY_S / STEP_S)):
                self._running.advance()
            waited_s += LOOK_EVERY_S
            possible_s += LOOK_EVERY_S if len(others) else 0.0
        if not possible_s:
            raise InputError(
                f"`net`: no car drove on {self._network.name} within {FIRST_VEHICLE_WITHIN_S:g} s; "
                "give routes for passenger vehicles, or a later begin"
            )

    def read(self) -> PlaneReading:
        """Return the vehicles as they are now."""
        return self._reader.read()

    def present(self, step: int) -> Frame:
        """Return the vehicles as they are now, as a frame."""
        now = self._reader.read()
        ask = self._running.sumo.vehicle
        on_foot = [body.is_pedestrian for body in now.body]
        speed, accel = (
            np.array([0.0 if walks else get(name) for name, walks in zip(now.row, on_foot, strict=True)])
            for get in (ask.getSpeed, ask.getAcceleration)
        )
        rows, heading = np.arange(len(now.body)), now.heading_rad
        return self._frame_of(step, now, rows, now.centres(), heading, (speed, np.zeros(len(rows)), accel))

    def frame(self, window: Sequence[PlaneReading], step: int, ego: str | None) -> Frame | None:
        """Return the smoothed frame, seen from the ego or the one that follows it; all vehicles if none is wanted."""
        middle = window[self.lead]
        if ego is None:
            return self._smoothed(window, list(middle.row), step)
        if ego not in middle.row and (ego := choose_plane_ego(middle)) is None:
            return None
        centres = middle.centres()
        near = np.hypot(*(centres - centres[middle.row[ego]]).T) <= self._reach_m + MARGIN_M
        names = [name for name, is_near in zip(middle.row, near, strict=True) if is_near]
        frame, me = self._smoothed(window, names, step), names.index(ego)
        if self._plane.in_roundabout is not None:
            # Lanes count from 1; what is on none is on no roundabout either.
            frame = replace(frame, on_roundabout=np.append(False, self._plane.in_roundabout)[frame.lane])
        away = np.hypot(frame.lon_m - frame.lon_m[me], frame.lat_m - frame.lat_m[me])
        kept = np.flatnonzero(away <= self._reach_m)
        columns: dict[str, Any] = {
            name: values[kept] for name, values in vars(frame).items() if isinstance(values, np.ndarray)
        }
        return replace(frame, **columns, ego=int(np.flatnonzero(kept == me)[0]))

    def _smoothed(self, window: Sequence[PlaneReading], names: Sequence[str], step: int) -> Frame:
        """Return vehicles of the window's middle, smoothed; before they come and after they leave they go on evenly."""
        middle = window[self.lead]
        place, direction = _tracks(window, names)
        weights = hann_weights(self.lead - 1)
        before, now, after = (
            np.tensordot(weights, place[k : k + len(weights)], axes=1).reshape(-1, 2) for k in range(3)
        )
        turn = np.tensordot(weights, direction[1:-1], axes=1).reshape(-1, 2)
        heading = np.arctan2(turn[:, 1], turn[:, 0])
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        velocity, change = (after - before) / (2.0 * STEP_S), (after - 2.0 * now + before) / STEP_S**2
        # A body that SUMO shifts sideways may point a little against its motion, but nobody drives backwards.
        speed = rounded(np.maximum((velocity * ahead).sum(axis=1), 0.0))
        lat_speed = rounded(ahead[:, 0] * velocity[:, 1] - ahead[:, 1] * velocity[:, 0])
        moving = speed, lat_speed, rounded((change * ahead).sum(axis=1))
        rows = np.array([middle.row[name] for name in names], dtype=np.int64)
        return self._frame_of(step, middle, rows, now, heading, moving)

    def _frame_of(
        self,
        step: int,
        snapshot: PlaneReading,
        rows: IntArray,
        place: FloatArray,
        heading: FloatArray,
        moving: tuple[FloatArray, FloatArray, FloatArray],
    ) -> Frame:
        """Return vehicles of a snapshot at places (n, 2); ``moving`` is speeds along and across, and accelerations."""
        bodies, names = [snapshot.body[row] for row in rows], list(snapshot.row)
        # The demands of networks in the box have nobody on foot.
        knows_persons = self._inflow is None
        return Frame(
            step=step,
            time_s=round(step * STEP_S, 6),
            episode=0,
            ego=NO_EGO_INDEX,
            vehicle_id=np.array([names[row] for row in rows], dtype=np.str_),
            lon_m=rounded(place[:, 0]),
            lat_m=rounded(place[:, 1]),
            heading_rad=rounded(heading),
            speed_mps=moving[0],
            lat_speed_mps=moving[1],
            accel_mps2=moving[2],
            lane=1 + lanes_of([snapshot.lanes[row] for row in rows], self._plane.graph, place),
            length_m=rounded(np.array([body.length_m for body in bodies], dtype=np.float64)),
            width_m=rounded(np.array([body.width_m for body in bodies], dtype=np.float64)),
            direction_rad=rounded(heading),
            vehicle_class=classes_of([body.kind for body in bodies]),
            pedestrian=np.array([body.is_pedestrian for body in bodies], dtype=np.bool_) if knows_persons else None,
            signals=snapshot.signals,
        )


def choose_plane_ego(snapshot: PlaneReading) -> str | None:
    """Return the name of the car that carries the sensor from now on; None if there is none.

    Of those that have driven for some seconds and have enough others around them it is the last to have set out, since
    it stays longest; failing that the one with most others around it.
    """
    candidates, others = _candidates(snapshot)
    if not len(candidates):
        return None
    departure = np.array([snapshot.body[row].departure_s for row in candidates])
    best = candidates[np.lexsort((-departure, np.maximum(ENOUGH_OTHERS - others, 0)))[0]]
    return list(snapshot.row)[int(best)]


def _candidates(snapshot: PlaneReading) -> tuple[IntArray, IntArray]:
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


def lanes_of(lanes: Sequence[tuple[int, ...]], graph: LaneGraph, place: FloatArray) -> IntArray:
    """Return the lane that each vehicle's middle is on, (n,): the last one that it has entered with more than its nose.

    Args:
        lanes: The lanes that each one's front was on, the present one first, ``NOWHERE`` off the graph.
        graph: The lanes.
        place: The middles, metres, shape (n, 2).
    """
    found = np.array([entered[0] for entered in lanes], dtype=np.int64)
    settled = found == NOWHERE
    for k in range(max(map(len, lanes), default=0)):
        lane = np.array([entered[k] if k < len(entered) else NOWHERE for entered in lanes], dtype=np.int64)
        along = graph.on_lane(lane, place[:, 0], place[:, 1])[0]
        known = ~settled & (lane != NOWHERE)
        found[known] = lane[known]
        settled |= known & (along >= 0.0)
    return found


def _tracks(window: Sequence[PlaneReading], names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return middles and directions (cosine, sine) of vehicles over the window, each of shape (w, n, 2)."""
    place = np.full((len(window), len(names), 2), np.nan)
    direction = place.copy()
    for k, snapshot in enumerate(window):
        rows = np.array([snapshot.row.get(name, -1) for name in names], dtype=np.int64)
        there = rows >= 0
        place[k, there] = snapshot.centres()[rows[there]]
        heading = snapshot.heading_rad[rows[there]]
        direction[k, there] = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    for n in np.flatnonzero(np.isnan(place[:, :, 0]).any(axis=0)):
        _go_on_evenly(place[:, n], direction[:, n])
    return place, direction


def _go_on_evenly(place: FloatArray, direction: FloatArray) -> None:
    """Fill in, in place, where a vehicle would be that is not in all snapshots: of its stay in the middle one alone."""
    there = ~np.isnan(place[:, 0])
    middle = len(place) // 2
    first = middle - int(np.argmin(np.append(there[middle::-1], False))) + 1
    last = middle + int(np.argmin(np.append(there[middle:], False))) - 1
    stays = last > first
    step_in = place[first + 1] - place[first] if stays else np.zeros(2)
    step_out = place[last] - place[last - 1] if stays else np.zeros(2)
    for k in range(first - 1, -1, -1):
        place[k], direction[k] = place[k + 1] - step_in, direction[first]
    for k in range(last + 1, len(place)):
        place[k], direction[k] = place[k - 1] + step_out, direction[last]
