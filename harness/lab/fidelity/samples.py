"""Samples of single vehicles' behaviour, taken by the same code from recorded and simulated frames.

Counted are vehicles on lanes, away from the ends of the stretch that is on record. A headway is the distance, or the
time at the follower's speed, between the fronts of two vehicles in a row on one lane.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.common.errors import InputError
from harness.truth.frame import STEP_S, Frame
from harness.truth.recorded.fcd import declares_types
from harness.truth.recorded.formats import network_of, read_traffic, recognise
from harness.truth.recorded.traffic import RecordedTraffic, assemble, check_one_road
from mmpf.map.road import NO_LANE
from mmpf.numerics.arrays import FloatArray

SAMPLE_EVERY_S = 1.0
END_M = 20.0
# A follower that creeps has no meaningful time headway.
SLOWEST_WITH_HEADWAY_MPS = 2.0
LONGEST_HEADWAY_M = 100.0
# A lane change lasts while the vehicle drifts at least this fast towards its new lane; one that is slower on the line
# is no change of lane but a vehicle between two.
DRIFT_MPS = 0.15

UNITS = {
    "speed": "m/s",
    "acceleration": "m/s²",
    "space_headway": "m",
    "time_headway": "s",
    "lateral_speed": "m/s",
    "lane_change_duration": "s",
    "vehicle_length": "m",
    "vehicle_width": "m",
}
RATE, RATE_UNIT = "lane_change_rate", "changes per vehicle and km"


@dataclass(frozen=True)
class VehicleStatistics:
    """What the driving of single vehicles is calibrated by.

    Attributes:
        acceleration_spread_mps2: Mean absolute difference of accelerations from their mean.
    """

    lane_changes_per_km: float
    acceleration_spread_mps2: float


@dataclass(frozen=True)
class BehaviourSamples:
    """Samples of each quantity of ``UNITS``, and how many lane changes there were on how many kilometres.

    Attributes:
        values: Samples by quantity, each of shape (n,).
    """

    values: dict[str, FloatArray]
    lane_changes: int
    vehicle_km: float

    @property
    def changes_per_km(self) -> float:
        """Lane changes per vehicle and kilometre; nan without any travel."""
        return self.lane_changes / self.vehicle_km if self.vehicle_km > 0.0 else float("nan")

    def statistics(self) -> VehicleStatistics:
        """Return the figures that drivers are calibrated by; nan where there are no samples."""
        acceleration = self.values["acceleration"]
        spread = float(np.mean(np.abs(acceleration - acceleration.mean()))) if len(acceleration) else float("nan")
        return VehicleStatistics(self.changes_per_km, spread)


def merged(parts: Iterable[BehaviourSamples]) -> BehaviourSamples:
    """Return the samples of several runs or recordings as one."""
    listed = list(parts)
    return BehaviourSamples(
        values={name: np.concatenate([part.values[name] for part in listed]) for name in UNITS},
        lane_changes=sum(part.lane_changes for part in listed),
        vehicle_km=sum(part.vehicle_km for part in listed),
    )


class Sampler:
    """Takes samples from frames that pass by."""

    def __init__(self, window_m: tuple[float, float], step_s: float) -> None:
        """Take the stretch of road that is on record."""
        self._start_m, self._end_m = window_m[0] + END_M, window_m[1] - END_M
        self._step_s = step_s
        self._every = max(1, round(SAMPLE_EVERY_S / step_s))
        self._values: dict[str, list[FloatArray]] = {name: [] for name in UNITS}
        self._sizes: dict[str, tuple[float, float]] = {}
        self._paths: list[tuple[FloatArray, ...]] = []
        self._numbers: dict[str, int] = {}
        self._travelled_m = 0.0

    def tap(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """Yield frames on, and take samples from them."""
        for number, frame in enumerate(frames):
            self._take(frame, number % self._every == 0)
            yield frame

    def samples(self) -> BehaviourSamples:
        """Return all samples taken."""
        durations = np.array(list(self._lane_changes()), dtype=np.float64)
        values = {name: np.concatenate(parts) if parts else np.zeros(0) for name, parts in self._values.items()}
        sizes = np.array(list(self._sizes.values()), dtype=np.float64).reshape(-1, 2)
        values |= {"lane_change_duration": durations, "vehicle_length": sizes[:, 0], "vehicle_width": sizes[:, 1]}
        return BehaviourSamples(values, len(durations), self._travelled_m / 1000.0)

    def _take(self, frame: Frame, sampled: bool) -> None:
        inside = (frame.lane != NO_LANE) & (frame.lon_m >= self._start_m) & (frame.lon_m < self._end_m)
        rows = np.flatnonzero(inside)
        names = [str(name) for name in frame.vehicle_id[rows]]
        for name in names:
            self._numbers.setdefault(name, len(self._numbers))
        self._travelled_m += self._step_s * float(frame.speed_mps[rows].sum())
        vehicle = np.array([self._numbers[name] for name in names], dtype=np.float64)
        when = np.full(len(rows), frame.step, dtype=np.float64)
        self._paths.append((vehicle, when, frame.lane[rows].astype(np.float64), frame.lat_speed_mps[rows]))
        if not sampled:
            return
        self._sizes |= dict(zip(names, zip(frame.length_m[rows], frame.width_m[rows], strict=True), strict=True))
        self._values["speed"].append(frame.speed_mps[rows])
        self._values["acceleration"].append(frame.accel_mps2[rows])
        self._values["lateral_speed"].append(frame.lat_speed_mps[rows])
        distance_m, speed_mps = _headways(frame, rows)
        self._values["space_headway"].append(distance_m)
        moving = speed_mps >= SLOWEST_WITH_HEADWAY_MPS
        self._values["time_headway"].append(distance_m[moving] / speed_mps[moving])

    def _lane_changes(self) -> Iterator[float]:
        """Yield the duration of each lane change between lanes that was seen from begin to end."""
        if not self._paths:
            return
        vehicle, step, lane, drift = (np.concatenate(parts) for parts in zip(*self._paths, strict=True))
        order = np.lexsort((step, vehicle))
        vehicle, step, lane, drift = vehicle[order], step[order], lane[order], drift[order]
        joined = (np.diff(vehicle) == 0) & (np.diff(step) == 1)
        for row in np.flatnonzero(joined & (np.abs(np.diff(lane)) == 1)):
            # Lane 1 is the leftmost, and drift is positive to the left.
            towards = drift * np.sign(lane[row] - lane[row + 1])
            if max(towards[row], towards[row + 1]) <= DRIFT_MPS:
                continue
            first, last = int(row), int(row) + 1
            while first > 0 and joined[first - 1] and towards[first] > DRIFT_MPS:
                first -= 1
            while last < len(joined) and joined[last] and towards[last] > DRIFT_MPS:
                last += 1
            yield (last - first) * self._step_s


def _headways(frame: Frame, rows: np.ndarray[tuple[int], np.dtype[np.intp]]) -> tuple[FloatArray, FloatArray]:
    """Return distances between fronts in each lane and the followers' speeds."""
    front = frame.lon_m[rows] + 0.5 * frame.length_m[rows]
    lane = frame.lane[rows]
    order = np.lexsort((front, lane))
    distance = np.diff(front[order])
    paired = (np.diff(lane[order]) == 0) & (distance < LONGEST_HEADWAY_M)
    return distance[paired], frame.speed_mps[rows][order][:-1][paired]


WHOLE_S = 86_400.0
SUFFIXES = (".xml", ".csv", ".txt", ".gz")


def recording_files(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Return the recordings in files and folders.

    Raises:
        InputError: A path does not exist or a folder holds no recording.
    """
    found: list[Path] = []
    for path in paths:
        if not path.exists():
            raise InputError(f"`recordings` {path}: does not exist; give files or folders of recorded traffic")
        in_folder = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES) if path.is_dir() else [path]
        inside = [file for file in in_folder if file == path or not declares_types(file)]
        if not inside:
            raise InputError(f"`recordings` {path}: the folder holds no recorded traffic")
        found += inside
    return tuple(found)


def recorded_samples(files: Iterable[Path], net: str) -> BehaviourSamples:
    """Return the samples of all recordings as one.

    Raises:
        InputError: One is no recording or is broken.
    """
    return merged(_samples(path, net) for path in files)


def whole_recording(path: Path, net: str | None = None) -> RecordedTraffic:
    """Return all traffic of a file, on the named network where the file has no road.

    Raises:
        InputError: It is no recording, is broken, or is of more than one road.
    """
    entry = recognise(path)
    read = read_traffic(path, entry.name, network_of(entry, None if entry.brings_road else net))
    traffic = assemble(read, path, WHOLE_S)
    check_one_road(traffic, path)
    return traffic


def _samples(path: Path, net: str) -> BehaviourSamples:
    traffic = whole_recording(path, net)
    sampler = Sampler(traffic.window_m, STEP_S)
    for _ in sampler.tap(traffic.frame(step, step, 0, int(traffic.stay[0])) for step in range(traffic.steps)):
        pass
    return sampler.samples()
