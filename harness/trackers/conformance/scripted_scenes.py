"""Small scenes with known answers: cars at constant speed, without occlusion."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from harness.trackers.protocol import TrackerSetting
from mmpf.map.corridor_road import highway
from mmpf.numerics.arrays import FloatArray, IntArray, taken
from mmpf.scan import BodySizes, Detections, EgoPose, Scan, SensorModel

ROAD = highway(section_m=(0.0, 2000.0))
SENSOR = SensorModel()
STD_LON_M, STD_LAT_M = 0.3, 0.2
LENGTH_M, WIDTH_M = 4.7, 1.9
STD_SIZE_SHARE = 0.1
EGO_SPEED_MPS = 20.0
EGO_START_M = 200.0
STEP_S = TrackerSetting.step_s


@dataclass(frozen=True)
class ScriptedCar:
    """A car that holds its speed and lane, detected between two times."""

    name: str
    lon_m: float
    lane: int = 2
    speed_mps: float = EGO_SPEED_MPS
    from_s: float = 0.0
    until_s: float = np.inf

    @property
    def lat_m(self) -> float:
        """Lateral position: the middle of its lane."""
        return next(lane.centre_m for lane in ROAD.lanes if lane.number == self.lane)

    def lon_at(self, time_s: float) -> float:
        """Return the longitudinal position at a time."""
        return self.lon_m + self.speed_mps * time_s

    def place_at(self, time_s: float) -> tuple[float, float]:
        """Return the longitudinal and lateral position at a time."""
        return self.lon_at(time_s), self.lat_m


@dataclass(frozen=True)
class LabelledScan:
    """A scan and the car behind each of its detections, empty for clutter, shape (d,)."""

    scan: Scan
    truth_id: npt.NDArray[np.str_]


def ego_at(time_s: float) -> EgoPose:
    """Return the pose of the ego, which drives in the middle lane."""
    return EgoPose(EGO_START_M + EGO_SPEED_MPS * time_s, 2.5 * 3.66, 0.0, EGO_SPEED_MPS, LENGTH_M, WIDTH_M)


def detections_at(lon_m: FloatArray, lat_m: FloatArray) -> Detections:
    """Return detections of cars of one size, without speed, of the nominal noise."""
    size = len(lon_m)
    return Detections(
        lon_m=np.asarray(lon_m, dtype=np.float64),
        lat_m=np.asarray(lat_m, dtype=np.float64),
        speed_mps=np.full(size, np.nan),
        std_lon_m=np.full(size, STD_LON_M),
        std_lat_m=np.full(size, STD_LAT_M),
        std_speed_mps=np.full(size, np.nan),
        sizes=BodySizes(
            length_m=np.full(size, LENGTH_M),
            width_m=np.full(size, WIDTH_M),
            std_length_m=np.full(size, STD_SIZE_SHARE * LENGTH_M),
            std_width_m=np.full(size, STD_SIZE_SHARE * WIDTH_M),
        ),
    )


def labelled_scan(time_s: float, lon_m: Sequence[float], lat_m: Sequence[float], names: Sequence[str]) -> LabelledScan:
    """Return one scan of given detections."""
    detections = detections_at(np.array(lon_m, dtype=np.float64), np.array(lat_m, dtype=np.float64))
    return LabelledScan(Scan(time_s, detections, ego_at(time_s)), np.array(list(names), dtype=np.str_))


def scripted_scans(
    cars: Sequence[ScriptedCar],
    times_s: Sequence[float],
    rng: np.random.Generator,
    detection_probability: float = 1.0,
    clutter_per_scan: float = 0.0,
) -> list[LabelledScan]:
    """Return scans of the cars from a sensor without occlusion.

    Args:
        detection_probability: For each car and scan.
        clutter_per_scan: Expected number of false detections, spread over the road within range.
    """
    return [_look(cars, float(time_s), rng, detection_probability, clutter_per_scan) for time_s in times_s]


def separate_cars() -> list[ScriptedCar]:
    """Return four cars, each alone within 30 m."""
    return [
        ScriptedCar("ahead", EGO_START_M + 40.0, lane=3, speed_mps=EGO_SPEED_MPS + 2.0),
        ScriptedCar("behind", EGO_START_M - 40.0, lane=3, speed_mps=EGO_SPEED_MPS - 1.0),
        ScriptedCar("left", EGO_START_M + 5.0, lane=1, speed_mps=EGO_SPEED_MPS + 3.0),
        ScriptedCar("right", EGO_START_M - 5.0, lane=5, speed_mps=EGO_SPEED_MPS - 3.0),
    ]


def busy_scene() -> list[LabelledScan]:
    """Return 4 s of four cars with missed and false detections."""
    rng = np.random.default_rng(11)
    return scripted_scans(separate_cars(), times_every_step(4.0), rng, detection_probability=0.9, clutter_per_scan=1.0)


def times_every_step(until_s: float) -> list[float]:
    """Return the times of scans ``STEP_S`` apart from zero until then."""
    return [round(step * STEP_S, 6) for step in range(round(until_s / STEP_S) + 1)]


def shuffled(scan: LabelledScan, order: IntArray) -> LabelledScan:
    """Return the scan with its detections in another order."""
    old = scan.scan.detections
    return LabelledScan(Scan(scan.scan.time_s, taken(old, order), scan.scan.ego), scan.truth_id[order])


def without_sizes(scan: LabelledScan) -> LabelledScan:
    """Return the scan as a sensor gives it that measures no sizes."""
    detections = replace(scan.scan.detections, sizes=None)
    return replace(scan, scan=replace(scan.scan, detections=detections))


def impossible_versions(good: Detections) -> Iterator[tuple[str, Detections]]:
    """Yield what no sensor can have measured, made from a scan's detections with sizes, and what is wrong with it."""
    for name, value in (("lon_m", np.nan), ("lat_m", np.inf), ("std_lon_m", -1.0), ("std_lat_m", np.nan)):
        spoilt: dict[str, Any] = {name: _spoilt(getattr(good, name), value)}
        yield f"detections.{name} = {value}", replace(good, **spoilt)
    sizes = good.sizes
    assert sizes is not None
    for name, value in (("length_m", np.nan), ("width_m", -1.0), ("std_length_m", 0.0)):
        bad = replace(sizes, **{name: _spoilt(getattr(sizes, name), value)})
        yield f"detections.sizes.{name} = {value}", replace(good, sizes=bad)
    yield "columns of different lengths", replace(good, lat_m=good.lat_m[:-1])


def _look(
    cars: Sequence[ScriptedCar],
    time_s: float,
    rng: np.random.Generator,
    detection_probability: float,
    clutter_per_scan: float,
) -> LabelledScan:
    ego = ego_at(time_s)
    seen = [
        car
        for car in cars
        if car.from_s <= time_s <= car.until_s
        and abs(car.lon_at(time_s) - ego.lon_m) < SENSOR.range_m
        and rng.random() < detection_probability
    ]
    false = int(rng.poisson(clutter_per_scan))
    lon_m = [car.lon_at(time_s) + rng.normal(0.0, STD_LON_M) for car in seen]
    lat_m = [car.lat_m + rng.normal(0.0, STD_LAT_M) for car in seen]
    lon_m += (ego.lon_m + rng.uniform(-SENSOR.range_m, SENSOR.range_m, false)).tolist()
    lat_m += rng.uniform(0.0, 5 * 3.66, false).tolist()
    names = [car.name for car in seen] + [""] * false
    return shuffled(labelled_scan(time_s, lon_m, lat_m, names), rng.permutation(len(names)))


def _spoilt(column: FloatArray, value: float) -> FloatArray:
    spoilt = column.copy()
    spoilt[0] = value
    return spoilt
