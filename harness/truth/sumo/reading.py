"""Converts SUMO's vehicles into frames: centres in the road frame instead of front bumpers in SUMO's plane."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.truth.frame import EVERYWHERE, STEP_S, Frame
from harness.truth.sumo.session import Sumo
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.road import NO_LANE, Road
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.scan import BUS, CAR, MOTORCYCLE, TRAILER, TRUCK, UNKNOWN_CLASS

NO_EGO_INDEX = -1
BESIDE_SECTION_M = 150.0
OFF_ROAD_WITHIN_M = 15.0
CLASSES = {"passenger": CAR, "truck": TRUCK, "delivery": CAR, "trailer": TRAILER, "bus": BUS, "coach": BUS}
CLASSES |= dict.fromkeys(("private", "taxi", "evehicle", "hov", "emergency", "authority", "vip"), CAR)
CLASSES |= dict.fromkeys(("motorcycle", "moped", "scooter"), MOTORCYCLE)


def read_frame(sumo: Sumo, road: CorridorRoad, step: int) -> Frame:
    """Return the vehicles within 150 m of the section, not smoothed; the frame has no ego yet.

    SUMO's lateral position is taken as the centre's, so that lateral speed is its derivative; on a ramp, which lies at
    an angle to the road, the centre is half a length behind the front bumper along SUMO's heading.
    """
    vehicle = sumo.vehicle
    names = vehicle.getIDList()
    front_lon, front_lat = front_positions(sumo, road, names)
    start_m, end_m = road.section_m
    near = (front_lon > start_m - BESIDE_SECTION_M) & (front_lon < end_m + BESIDE_SECTION_M)
    near &= beside_the_road(road, front_lat)
    chosen = np.flatnonzero(near)
    names = [names[k] for k in chosen]
    front_lon, front_lat = front_lon[chosen], front_lat[chosen]

    length = np.array([vehicle.getLength(name) for name in names])
    speed = np.array([vehicle.getSpeed(name) for name in names])
    lat_speed = np.array([vehicle.getLateralSpeed(name) for name in names])
    drift = np.arctan2(lat_speed, np.maximum(speed, 3.0 * np.abs(lat_speed) + 1e-9))
    heading, along_road = drift.copy(), np.ones(len(names), dtype=bool)
    on_ramp = np.flatnonzero(road.lane_number_at(front_lon, front_lat) == NO_LANE)
    along_road[on_ramp] = False
    # SUMO's angle is a compass's, clockwise from north; ours runs counterclockwise from the x axis.
    heading[on_ramp] = [np.radians(90.0 - vehicle.getAngle(names[k])) for k in on_ramp]
    heading[on_ramp] -= road.heading_at(front_lon[on_ramp])
    lon = front_lon - 0.5 * length * np.where(along_road, 1.0, np.cos(heading))
    lat = front_lat - 0.5 * length * np.where(along_road, 0.0, np.sin(heading))
    return Frame(
        step=step,
        time_s=round(step * STEP_S, 6),
        episode=0,
        ego=NO_EGO_INDEX,
        vehicle_id=np.array(names, dtype=np.str_),
        lon_m=lon,
        lat_m=lat,
        heading_rad=(heading + np.pi) % (2.0 * np.pi) - np.pi,
        speed_mps=np.where(along_road, speed, speed * np.cos(heading)),
        lat_speed_mps=np.where(along_road, lat_speed, speed * np.sin(heading)),
        accel_mps2=np.array([vehicle.getAcceleration(name) for name in names]),
        lane=road.lane_number_at(lon, lat),
        length_m=length,
        width_m=np.array([vehicle.getWidth(name) for name in names]),
        vehicle_class=classes_of([vehicle.getVehicleClass(name) for name in names]),
    )


def classes_of(kinds: Sequence[str]) -> IntArray:
    """Return the codes of SUMO's classes of vehicles, shape (n,); of those of no car, truck, bus and so on 0."""
    return np.array([CLASSES.get(kind, UNKNOWN_CLASS) for kind in kinds], dtype=np.int64)


@dataclass(frozen=True)
class Load:
    """How many vehicles are on the road's lanes before and in the section, and the mean speed inside; 0 for none."""

    approaching: int
    inside: int
    mean_speed_mps: float


def read_load(sumo: Sumo, road: CorridorRoad) -> Load:
    """Count the vehicles before and in the section."""
    names = sumo.vehicle.getIDList()
    lon, lat = front_positions(sumo, road, names)
    start_m, end_m = road.section_m
    on_lane = road.lane_number_at(lon, lat) != NO_LANE
    inside = np.flatnonzero(on_lane & (lon >= start_m) & (lon < end_m))
    speeds = [sumo.vehicle.getSpeed(names[k]) for k in inside]
    return Load(
        approaching=int(np.sum(on_lane & (lon < start_m))),
        inside=len(speeds),
        mean_speed_mps=float(np.mean(speeds)) if speeds else 0.0,
    )


def front_positions(sumo: Sumo, road: Road, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return the front bumpers' longitudinal and lateral positions, each (n,)."""
    position = sumo.vehicle.getPosition
    xy = np.array([position(name) for name in names], dtype=np.float64).reshape(-1, 2)
    return road.to_road(xy[:, 0], xy[:, 1])


def beside_the_road(road: Road, lat_m: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which places are within 15 m of a lane, sideways."""
    right_m, left_m = road.across_m(EVERYWHERE, 0.0, 0.0)
    return np.asarray((lat_m > right_m - OFF_ROAD_WITHIN_M) & (lat_m < left_m + OFF_ROAD_WITHIN_M))
