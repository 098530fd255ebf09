"""Samples of single vehicles' behaviour, taken by the same code from recorded and simulated frames.

Counted are vehicles on lanes, away from the ends of the stretch that is on record. A headway is the distance, or the
time at the follower's speed, between the fronts of two vehicles in a row on one lane.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from harness.common.errors import InputError
from harness.storage.tables import floats
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
COLUMNS = ("vehicle_id", "lane", "lon_m", "speed_mps", "lat_speed_mps", "accel_mps2", "length_m", "width_m")


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
        by_quantity: Samples of each, each of shape (n,).
    """

    by_quantity: dict[str, FloatArray]
    lane_changes: int
    vehicle_km: float

    @property
    def changes_per_km(self) -> float:
        """Lane changes per vehicle and kilometre; nan without any travel."""
        return self.lane_changes / self.vehicle_km if self.vehicle_km > 0.0 else float("nan")

    def statistics(self) -> VehicleStatistics:
        """Return the figures that drivers are calibrated by; nan where there are no samples."""
        acceleration = self.by_quantity["acceleration"]
        spread = float(np.mean(np.abs(acceleration - acceleration.mean()))) if len(acceleration) else float("nan")
        return VehicleStatistics(self.changes_per_km, spread)


def merged(parts: Iterable[BehaviourSamples]) -> BehaviourSamples:
    """Return the samples of several runs or recordings as one."""
    listed = list(parts)
    return BehaviourSamples(
        by_quantity={name: np.concatenate([part.by_quantity[name] for part in listed]) for name in UNITS},
        lane_changes=sum(part.lane_changes for part in listed),
        vehicle_km=sum(part.vehicle_km for part in listed),
    )


def samples_of(frames: Sequence[Frame], window_m: tuple[float, float], step_s: float) -> BehaviourSamples:
    """Return the samples of frames that follow each other; quantities are sampled every second, changes counted all.

    Args:
        window_m: The stretch of road that is on record.
    """
    columns = {name: np.concatenate([getattr(frame, name) for frame in frames] or [np.zeros(0)]) for name in COLUMNS}
    number = np.repeat(np.arange(len(frames)), [len(frame) for frame in frames])
    rows = pd.DataFrame({**columns, "number": number})
    inside = (rows["lon_m"] >= window_m[0] + END_M) & (rows["lon_m"] < window_m[1] - END_M)
    rows = rows[inside & (rows["lane"] != NO_LANE)]
    durations = np.array(list(_lane_changes(rows, step_s)), dtype=np.float64)
    travelled_m = step_s * float(rows["speed_mps"].sum())
    rows = rows[rows["number"] % max(1, round(SAMPLE_EVERY_S / step_s)) == 0]
    sizes = rows.drop_duplicates("vehicle_id", keep="last")
    distance_m, follower_mps = _headways(rows)
    moving = follower_mps >= SLOWEST_WITH_HEADWAY_MPS
    values = {
        "speed": floats(rows, "speed_mps"),
        "acceleration": floats(rows, "accel_mps2"),
        "space_headway": distance_m,
        "time_headway": distance_m[moving] / follower_mps[moving],
        "lateral_speed": floats(rows, "lat_speed_mps"),
        "lane_change_duration": durations,
        "vehicle_length": floats(sizes, "length_m"),
        "vehicle_width": floats(sizes, "width_m"),
    }
    return BehaviourSamples(values, len(durations), travelled_m / 1000.0)


def _lane_changes(rows: pd.DataFrame, step_s: float) -> Iterator[float]:
    """Yield the duration of each lane change between lanes that was seen from begin to end."""
    rows = rows.sort_values(["vehicle_id", "number"])
    lane, drift = floats(rows, "lane"), floats(rows, "lat_speed_mps")
    same = rows["vehicle_id"].to_numpy()[1:] == rows["vehicle_id"].to_numpy()[:-1]
    joined = same & (np.diff(rows["number"].to_numpy()) == 1)
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
        yield (last - first) * step_s


def _headways(rows: pd.DataFrame) -> tuple[FloatArray, FloatArray]:
    """Return distances between fronts in each lane and the followers' speeds."""
    rows = rows.assign(front=rows["lon_m"] + 0.5 * rows["length_m"]).sort_values(["number", "lane", "front"])
    distance_m = -rows.groupby(["number", "lane"])["front"].diff(-1).to_numpy(dtype=np.float64)
    paired = distance_m < LONGEST_HEADWAY_M
    return distance_m[paired], floats(rows, "speed_mps")[paired]


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
    """Return the samples of all recordings as one."""
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
    frames = [traffic.frame(step, step, 0, int(traffic.stay[0])) for step in range(traffic.steps)]
    return samples_of(frames, traffic.window_m, STEP_S)
