"""Reads SUMO's vehicles in the plane: front positions, headings and lanes.

SUMO moves front bumpers along lanes, and its angles jump where lanes meet. So a vehicle's heading follows from its
front's way: the front pulls a rear axle that rolls without slipping, as in the bicycle model.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from harness.truth.frame import CLOSED, OPEN
from harness.truth.network.lanegraph import PlaneNetwork
from harness.truth.sumo.session import Sumo
from mmpf.map.lane_graph import NOWHERE
from mmpf.numerics.arrays import FloatArray

# They share no road with cars, and many are longer than a rigid body on a bend can be.
NOT_ON_ROADS = frozenset(
    {
        *("rail", "rail_urban", "rail_electric", "rail_fast", "subway", "cable_car"),
        *("ship", "container", "aircraft", "drone", "pedestrian"),
    }
)
NO_CAR = frozenset({"bicycle", "moped", "motorcycle", "scooter", "wheelchair", "tram"})
CAR_LENGTH_M = (3.0, 6.5)
PEDESTRIAN = "pedestrian"
# Persons may be called as vehicles are.
PERSON_NAME = "person:{}"
# SUMO's letters for signals by which vehicles may go: green with and without priority, off, and off but blinking.
LETS_GO = frozenset("GgOo")
# From the front bumper to the rear axle, as a share of the length.
REAR_AXLE_SHARE = 0.8
# Whoever is farther from where it was a step ago did not drive there: SUMO has teleported it.
FARTHEST_STEP_M = 50.0
FARTHEST_M = 1e8
REMEMBERED_LANES = 4


@dataclass(frozen=True)
class Body:
    """What of a vehicle never changes; ``kind`` is SUMO's class of vehicles."""

    length_m: float
    width_m: float
    kind: str
    departure_s: float

    @property
    def is_car(self) -> bool:
        """Whether it may carry the sensor."""
        return (
            self.kind not in NO_CAR and not self.is_pedestrian and CAR_LENGTH_M[0] <= self.length_m <= CAR_LENGTH_M[1]
        )

    @property
    def is_pedestrian(self) -> bool:
        """Whether it is a person on foot."""
        return self.kind == PEDESTRIAN


@dataclass(frozen=True)
class PlaneReading:
    """All vehicles of a network and persons on foot at one instant, struct of arrays over n of them.

    Attributes:
        front_x: Where the middle of its front bumper is, metres, shape (n,).
        heading_rad: Its heading, counter-clockwise from x, shape (n,).
        lanes: Lanes of the graph that its front was on, the present one first, ``NOWHERE`` for those of no graph.
        signals: State of each signal of the graph; see ``Frame.signals``.
    """

    time_s: float
    row: dict[str, int]
    body: list[Body]
    front_x: FloatArray
    front_y: FloatArray
    heading_rad: FloatArray
    lanes: list[tuple[int, ...]]
    signals: str = ""

    def centres(self) -> FloatArray:
        """Return the middles of all vehicles, metres, shape (n, 2)."""
        half = 0.5 * np.array([body.length_m for body in self.body])
        x = self.front_x - half * np.cos(self.heading_rad)
        return np.stack([x, self.front_y - half * np.sin(self.heading_rad)], axis=-1)


class _LastReading(NamedTuple):
    """What is remembered of a vehicle: its front and rear axle a step ago, and its lanes, the present one first."""

    front: tuple[float, float]
    rear: tuple[float, float]
    lane_name: str
    lanes: tuple[int, ...]


class PlaneReader:
    """Reads one snapshot a step; what it remembers of vehicles gives their headings and lanes."""

    def __init__(self, sumo: Sumo, plane: PlaneNetwork) -> None:
        """Begin without a memory."""
        self._sumo = sumo
        self._origin = plane.origin_xy
        self._lane = {name: k for k, name in enumerate(plane.graph.name)}
        control = plane.graph.control
        self._signals = [] if control is None else [_light(name) for name in control.signal_name]
        self._bodies: dict[str, Body] = {}
        self._kept: dict[str, _LastReading] = {}

    def read(self) -> PlaneReading:
        """Return who drives, stands or walks on the network now; parked and teleporting vehicles are left out."""
        vehicle = self._sumo.vehicle
        bodies, kept = self._bodies, self._kept
        self._bodies, self._kept = {}, {}
        for name in vehicle.getIDList():
            body = self._bodies[name] = bodies.get(name) or self._body(name)
            x, y = vehicle.getPosition(name)
            if body.kind in NOT_ON_ROADS or not (abs(x) < FARTHEST_M and abs(y) < FARTHEST_M):
                continue
            front, before = (x - self._origin[0], y - self._origin[1]), kept.get(name)
            if before is None:
                now = self._first(name, body, front)
            elif np.hypot(front[0] - before.front[0], front[1] - before.front[1]) > FARTHEST_STEP_M:
                continue
            else:
                now = self._next(name, body, front, before)
            if now.front == (before or now).front and vehicle.isStoppedParking(name):
                continue
            self._kept[name] = now
        for person in self._sumo.person.getIDList():
            self._keep_person(str(person), bodies)
        rows = list(self._kept.values())
        place = np.array([(*each.front, *each.rear) for each in rows], dtype=np.float64).reshape(-1, 4)
        return PlaneReading(
            time_s=float(self._sumo.simulation.getTime()),
            row={name: k for k, name in enumerate(self._kept)},
            body=[self._bodies[name] for name in self._kept],
            front_x=place[:, 0],
            front_y=place[:, 1],
            heading_rad=np.arctan2(place[:, 1] - place[:, 3], place[:, 0] - place[:, 2]),
            lanes=[each.lanes for each in rows],
            signals=self._states(),
        )

    def _keep_person(self, person: str, bodies: dict[str, Body]) -> None:
        """Remember where a person is, unless it rides in a vehicle."""
        of_persons = self._sumo.person
        x, y = of_persons.getPosition(person)
        if of_persons.getVehicle(person) or not (abs(x) < FARTHEST_M and abs(y) < FARTHEST_M):
            return
        name = PERSON_NAME.format(person)
        if name not in bodies:
            size = float(of_persons.getLength(person)), float(of_persons.getWidth(person))
            bodies[name] = Body(*size, PEDESTRIAN, float(self._sumo.simulation.getTime()))
        body = self._bodies[name] = bodies[name]
        heading = np.radians(90.0 - of_persons.getAngle(person))
        place, ahead = np.array([x, y]) - self._origin, np.array([np.cos(heading), np.sin(heading)])
        # SUMO's persons are where their middles are.
        front, rear = place + 0.5 * body.length_m * ahead, place - 0.5 * body.length_m * ahead
        self._kept[name] = _LastReading(
            (float(front[0]), float(front[1])), (float(rear[0]), float(rear[1])), "", (NOWHERE,)
        )

    def _states(self) -> str:
        lights = {light for light, _ in self._signals}
        shown = {light: str(self._sumo.trafficlight.getRedYellowGreenState(light)) for light in sorted(lights)}
        return "".join(OPEN if shown[light][index] in LETS_GO else CLOSED for light, index in self._signals)

    def _body(self, name: str) -> Body:
        vehicle = self._sumo.vehicle
        return Body(
            float(vehicle.getLength(name)),
            float(vehicle.getWidth(name)),
            str(vehicle.getVehicleClass(name)),
            float(vehicle.getDeparture(name)),
        )

    def _first(self, name: str, body: Body, front: tuple[float, float]) -> _LastReading:
        # SUMO's angle is a compass's, clockwise from north; ours runs counterclockwise from the x axis.
        heading = np.radians(90.0 - self._sumo.vehicle.getAngle(name))
        arm = REAR_AXLE_SHARE * body.length_m
        rear = (front[0] - arm * float(np.cos(heading)), front[1] - arm * float(np.sin(heading)))
        lane_name = str(self._sumo.vehicle.getLaneID(name))
        return _LastReading(front, rear, lane_name, (self._lane.get(lane_name, NOWHERE),))

    def _next(self, name: str, body: Body, front: tuple[float, float], before: _LastReading) -> _LastReading:
        if front == before.front:
            return before
        lane_name = str(self._sumo.vehicle.getLaneID(name))
        lanes = before.lanes
        if lane_name != before.lane_name:
            lanes = (self._lane.get(lane_name, NOWHERE), *lanes)[:REMEMBERED_LANES]
        return _LastReading(
            front, pulled(before.front, before.rear, front, REAR_AXLE_SHARE * body.length_m), lane_name, lanes
        )


def _light(signal: str) -> tuple[str, int]:
    """Return the traffic light that a signal belongs to, and its number there."""
    light, _, index = signal.rpartition(":")
    return light, int(index)


def pulled(
    before: tuple[float, float], rear: tuple[float, float], front: tuple[float, float], arm_m: float
) -> tuple[float, float]:
    """Return where a rear axle is after the front has moved.

    SUMO's vehicles can also change lanes sideways. What of a step goes farther sideways than forwards moves the whole
    body, so that it does not turn it.
    """
    cosine, sine = (before[0] - rear[0]) / arm_m, (before[1] - rear[1]) / arm_m
    step_x, step_y = front[0] - before[0], front[1] - before[1]
    forwards, sideways = step_x * cosine + step_y * sine, step_y * cosine - step_x * sine
    beyond = sideways - float(np.clip(sideways, -max(forwards, 0.0), max(forwards, 0.0)))
    rear_x, rear_y = rear[0] - beyond * sine, rear[1] + beyond * cosine
    away = float(np.hypot(front[0] - rear_x, front[1] - rear_y))
    if away < 0.1 * arm_m:
        return front[0] - arm_m * cosine, front[1] - arm_m * sine
    return front[0] - (front[0] - rear_x) * arm_m / away, front[1] - (front[1] - rear_y) * arm_m / away
