"""The truth source of labelled drives, one after the other, each from its own recording car."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from harness.common.errors import InputError
from harness.truth.frame import STEP_S, Frame
from harness.truth.recorded.detected.laidapart import laid_apart, road_of
from harness.truth.recorded.detected.origin import NOTHING, origins
from harness.truth.recorded.detected.recorded_drive import EGO, Drive, GivenBoxes, Labels, step_starts
from harness.truth.recorded.lanesdriven import lanes_driven
from harness.truth.recorded.motion import local_slope
from mmpf.map.lane_graph import NOWHERE
from mmpf.map.road import NO_LANE
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, turned
from mmpf.scan import CAR

# A station wagon carried KITTI's camera; the sizes of other recording cars differ by little.
EGO_SIZE_M = 4.8, 1.8
PARKED_WITHIN_M = 2.0
"""A vehicle that nine tenths of its labels put no farther than this from their middle is parked."""
UNSEEN_S = 0.5
"""Whoever is in no detection for as long is hidden, for whatever reason; shorter pauses are misses."""


@dataclass(frozen=True)
class Motion:
    """How labelled things move, along the rows of a drive's labels; arrays of shape (n,)."""

    speed_mps: FloatArray
    lat_speed_mps: FloatArray
    accel_mps2: FloatArray
    parked: BoolArray


@dataclass(frozen=True)
class DriveMoment:
    """A step of a drive with all that its source knows.

    Attributes:
        counts: Whether each thing of the frame is a vehicle that counts, shape (n,).
        covered: Whether its label says that something covers it, shape (n,).
        unseen: Whether no detection is of it for half a second or longer, shape (n,).
        given: The detections, shape (d,).
        origin: Index in the frame of the thing that each is of, ``NOTHING`` of a false one, shape (d,).
        drawn: Whether errors of the detections are to be drawn.
    """

    counts: BoolArray
    covered: BoolArray
    unseen: BoolArray
    given: GivenBoxes
    origin: IntArray
    drawn: bool


class DriveOnClock:
    """A drive whose labels have speeds, and whose detections know what they are of."""

    def __init__(self, drive: Drive, first_lane: int) -> None:
        """Work out what the drive's files don't say; ``first_lane`` is its first one among the lanes of all drives."""
        labels, ego = drive.labels, drive.ego
        self.drive, self.motion = drive, motion_of(labels)
        self._given_starts = step_starts(drive.given.step, len(ego))
        self._origin = origins(drive)
        label_starts = step_starts(labels.step, len(ego))
        # The ego comes before the labels of each step.
        self._starts, self._label_starts = label_starts + np.arange(len(ego) + 1), label_starts
        alone = np.zeros(len(ego), dtype=np.int64)
        x_speed, y_speed = local_slope(ego.x_m, alone), local_slope(ego.y_m, alone)
        ego_speed, _ = turned(x_speed, y_speed, ego.heading_rad)
        lane, ego_lane = lane_numbers(drive, first_lane)

        def column(of_labels: npt.NDArray[Any], of_ego: npt.NDArray[Any] | float) -> npt.NDArray[Any]:
            return np.insert(of_labels, label_starts[:-1], of_ego)

        self._columns = {
            "vehicle_id": np.append(drive.names, EGO)[column(labels.thing, len(drive.names))],
            "lon_m": column(labels.x_m, ego.x_m),
            "lat_m": column(labels.y_m, ego.y_m),
            "heading_rad": column(labels.heading_rad, ego.heading_rad),
            "direction_rad": column(labels.heading_rad, ego.heading_rad),
            "speed_mps": column(self.motion.speed_mps, ego_speed),
            "lat_speed_mps": column(self.motion.lat_speed_mps, 0.0),
            "accel_mps2": column(self.motion.accel_mps2, local_slope(ego_speed, alone)),
            "lane": column(lane, ego_lane),
            "length_m": column(labels.length_m, EGO_SIZE_M[0]),
            "width_m": column(labels.width_m, EGO_SIZE_M[1]),
            "parked": column(self.motion.parked, False),
        }
        if labels.vehicle_class is not None:
            self._columns["vehicle_class"] = column(labels.vehicle_class, CAR)
        self._known = {
            "counts": column(labels.counts, True),
            "covered": column(labels.covered, False),
            "unseen": column(unseen(labels, self._origin), False),
        }

    def frame(self, own_step: int, step: int, episode: int) -> Frame:
        """Return the truth of one of the drive's steps, the ego first."""
        columns: dict[str, Any] = {name: values[self._rows(own_step)] for name, values in self._columns.items()}
        return Frame(step=step, time_s=round(step * STEP_S, 6), episode=episode, ego=0, **columns)

    def moment(self, own_step: int) -> DriveMoment:
        """Return what else is known of one of the drive's steps; arrays begin with the ego where the frame's do."""
        given = slice(int(self._given_starts[own_step]), int(self._given_starts[own_step + 1]))
        origin = self._origin[given]
        return DriveMoment(
            **{name: values[self._rows(own_step)] for name, values in self._known.items()},
            given=self.drive.given.take(np.arange(given.start, given.stop)),
            origin=np.where(origin == NOTHING, NOTHING, origin - int(self._label_starts[own_step]) + 1),
            drawn=self.drive.drawn,
        )

    def _rows(self, own_step: int) -> slice:
        return slice(int(self._starts[own_step]), int(self._starts[own_step + 1]))

    @property
    def vehicles(self) -> int:
        """How many labelled vehicles count."""
        return len(np.unique(self.drive.labels.thing[self.drive.labels.counts]))

    @property
    def false_detections(self) -> int:
        """How many detections are of nothing that is labelled."""
        return int((self._origin == NOTHING).sum())


def lane_numbers(drive: Drive, first_lane: int) -> tuple[IntArray, IntArray]:
    """Return the numbers of the lanes that labels, (n,), and the recording car, (steps,), are on, ``NO_LANE`` for none.

    Labels that are no vehicles are on none.
    """
    labels, ego = drive.labels, drive.ego
    numbers = np.full(len(labels) + len(ego), NO_LANE)
    if drive.lanes is not None:
        own = np.append(np.flatnonzero(labels.counts), len(labels) + np.arange(len(ego)))
        columns = ("x_m", "y_m", "heading_rad")
        x, y, heading = (np.concatenate([getattr(labels, name), getattr(ego, name)])[own] for name in columns)
        stay = np.concatenate([labels.thing, np.full(len(ego), len(drive.names))])[own]
        lane = lanes_driven(drive.lanes, stay, x, y, heading)
        numbers[own] = np.where(lane == NOWHERE, NO_LANE, lane + first_lane)
    return numbers[: len(labels)], numbers[len(labels) :]


def motion_of(labels: Labels) -> Motion:
    """Return how labelled things move: slopes of their places by least squares over half a second to either side."""
    order = np.lexsort((labels.step, labels.thing))
    thing, step = labels.thing[order], labels.step[order]
    # A thing that was not labelled for a while begins anew: no slope reaches over the pause.
    stay = np.cumsum((np.diff(thing, prepend=-1) != 0) | (np.diff(step, prepend=-1) != 1))
    x_speed, y_speed = local_slope(labels.x_m[order], stay), local_slope(labels.y_m[order], stay)
    speed, lat_speed = turned(x_speed, y_speed, labels.heading_rad[order])
    columns = np.stack([speed, lat_speed, local_slope(speed, stay)])
    back = np.argsort(order)
    speed, lat_speed, accel = columns[:, back]
    return Motion(speed, lat_speed, accel, parked=_parked(labels))


def _parked(labels: Labels) -> BoolArray:
    parked = np.zeros(len(labels), dtype=np.bool_)
    for thing in np.unique(labels.thing):
        rows = labels.thing == thing
        x, y = labels.x_m[rows], labels.y_m[rows]
        away = np.hypot(x - np.median(x), y - np.median(y))
        parked[rows] = np.quantile(away, 0.9) <= PARKED_WITHIN_M
    return parked


def unseen(labels: Labels, origin: IntArray) -> BoolArray:
    """Return which labels are in a time of ``UNSEEN_S`` or longer without a detection of their thing, shape (n,).

    Args:
        labels: The labels.
        origin: Row of the label that each detection is of, or ``NOTHING``, shape (d,).
    """
    seen = np.zeros(len(labels), dtype=np.bool_)
    seen[origin[origin != NOTHING]] = True
    order = np.lexsort((labels.step, labels.thing))
    changes = (np.diff(labels.thing[order], prepend=-1) != 0) | (np.diff(seen[order].astype(np.int64), prepend=-1) != 0)
    run = np.cumsum(changes) - 1
    long_enough = np.bincount(run) >= round(UNSEEN_S / STEP_S) if len(run) else np.zeros(0, dtype=np.bool_)
    result = np.zeros(len(labels), dtype=np.bool_)
    result[order] = ~seen[order] & long_enough[run]
    return result


class DriveTruth:
    """Frames of drives, one episode a drive; the road has all drives' lanes apart, or is the plane without any."""

    def __init__(self, path: Path, format_name: str, drives: Sequence[Drive]) -> None:
        """Take the drives in the order in which they are played."""
        placed = laid_apart(drives)
        self.road = road_of(placed)
        self.step_s = STEP_S
        lanes = [0 if drive.lanes is None else len(drive.lanes) for drive in placed]
        first_lanes = 1 + np.cumsum([0, *lanes])[:-1]
        self.drives = tuple(DriveOnClock(*each) for each in zip(placed, first_lanes.tolist(), strict=True))
        self._starts = np.concatenate([[0], np.cumsum([len(drive.ego) for drive in drives])]).astype(np.int64)
        self.expected_steps = int(self._starts[-1])
        self._path, self._format = path, format_name

    def frames(self) -> Iterator[Frame]:
        """Yield the frames; time continues from drive to drive."""
        for episode, drive in enumerate(self.drives):
            for own_step in range(len(drive.drive.ego)):
                yield drive.frame(own_step, int(self._starts[episode]) + own_step, episode)

    def moment(self, frame: Frame) -> DriveMoment:
        """Return what else is known of a frame."""
        return self.drives[frame.episode].moment(frame.step - int(self._starts[frame.episode]))

    def close(self) -> None:
        """Do nothing: everything has been read."""

    def report(self) -> str:
        """Return what was read and left out, in a few lines for the user."""
        summary = self.summary()
        left_out = ", ".join(f"{count} {reason}" for reason, count in self._left_out().items() if count) or "nothing"
        return (
            f"{self._path.name} ({self._format}): {len(self.drives)} drives, {self.expected_steps * STEP_S:.1f} s, "
            f"{summary['vehicles_kept']} labelled vehicles, {summary['parked']} of them parked; "
            f"{summary['detections']} detections given, {summary['false_detections']} of nothing that is labelled; "
            f"{f'maps with {lanes} lanes' if (lanes := summary['lanes']) else 'no map'}\n"
            f"left out: {left_out}"
        )

    def summary(self) -> dict[str, object]:
        """Return the same as a table for ``metrics.json``."""
        parked = [np.unique(d.drive.labels.thing[d.motion.parked & d.drive.labels.counts]) for d in self.drives]
        vehicles = sum(drive.vehicles for drive in self.drives)
        return {
            "file": self._path.name,
            "format": self._format,
            "ego": EGO,
            "egos": len(self.drives),
            "seconds": self.expected_steps * STEP_S,
            "vehicles_read": sum(len(drive.drive.names) for drive in self.drives),
            "vehicles_kept": vehicles,
            "parked": sum(map(len, parked)),
            "detections": sum(len(drive.drive.given) for drive in self.drives),
            "false_detections": sum(drive.false_detections for drive in self.drives),
            "lanes": sum(len(drive.drive.lanes or ()) for drive in self.drives),
            "left_out": self._left_out(),
        }

    def _left_out(self) -> Mapping[str, int]:
        total = Counter[str]()
        for drive in self.drives:
            total.update(drive.drive.left_out)
        return dict(total)


def open_drives(
    path: Path, format_name: str, drives: Sequence[Drive], duration_s: float, start_s: float, least_score: float
) -> DriveTruth:
    """Return the seconds that are used of each drive.

    Raises:
        InputError: All drives have ended by then.
    """
    first, steps = round(start_s / STEP_S), max(1, round(duration_s / STEP_S))
    used = [drive.scored_above(least_score).cut(first, steps) for drive in drives if len(drive.ego) > first]
    if not used:
        raise InputError(f"`traffic.recording.start_s` {start_s:g}: every drive of {path} has ended by then")
    return DriveTruth(path, format_name, used)
