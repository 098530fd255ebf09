"""Recorded traffic on one clock, in the road frame, step by step."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from harness.common.errors import InputError
from harness.truth.frame import EVERYWHERE, STEP_S, Frame
from harness.truth.recorded.lanesdriven import lanes_driven
from harness.truth.recorded.motion import completed
from harness.truth.recorded.order import Stays, order_rows
from harness.truth.recorded.plausible import check_units
from harness.truth.recorded.resample import Clocked, on_clock
from harness.truth.recorded.rows import ReadTraffic, Rows
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.limits import lanes_problem
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, IntArray, StringArray

# Where so many vehicles come or go so near to each other is an edge of what was recorded.
EDGE_VEHICLES = 3
EDGE_WIDTH_M = 5.0
FRAME_COLUMNS = ("lon_m", "lat_m", "heading_rad", "speed_mps", "lat_speed_mps", "length_m", "width_m")


@dataclass(frozen=True)
class ReadingCounts:
    """What became of a file's vehicles and rows; contradictions are duplicates that gave another position."""

    vehicles_read: int
    vehicles_kept: int
    left_out: Mapping[str, int]
    rows_kept: int
    duplicates: int
    contradictions: int
    filled: int


@dataclass(frozen=True)
class RecordedTraffic:
    """All vehicles at every step; rows sorted by step, then by stay.

    Attributes:
        window_m: Stretch of the road that is on record.
        step_starts: First row of each step and the row after the last, shape (steps + 1,).
        stay: Stay of each row, an index into ``names``, shape (n,).
        columns: The columns of ``Frame`` that are floats, each of shape (n,), and ``accel_mps2``.
        classes: Code of the class of each stay (``mmpf.scan.VEHICLE_CLASSES``); None if nobody tells.
    """

    road: Road
    window_m: tuple[float, float]
    step_starts: IntArray
    stay: IntArray
    names: StringArray
    columns: Mapping[str, FloatArray]
    lane: IntArray
    counts: ReadingCounts
    notes: tuple[str, ...]
    classes: IntArray | None = None

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.step_starts) - 1

    @property
    def knows_ends(self) -> bool:
        """Whether it is known where on the road what is on record ends."""
        return bool(np.isfinite(self.window_m).all())

    @property
    def step_of_row(self) -> IntArray:
        """Step of each row, shape (n,)."""
        return np.repeat(np.arange(self.steps), np.diff(self.step_starts))

    def frame(self, recorded_step: int, step: int, episode: int, ego_stay: int) -> Frame:
        """Return what is on record of one step, as step ``step`` of a run whose ego is the stay ``ego_stay``."""
        rows = slice(int(self.step_starts[recorded_step]), int(self.step_starts[recorded_step + 1]))
        stay = self.stay[rows]
        return Frame(
            step=step,
            time_s=round(step * STEP_S, 6),
            episode=episode,
            ego=int(np.searchsorted(stay, ego_stay)),
            vehicle_id=self.names[stay],
            lane=self.lane[rows],
            window_m=self.window_m,
            direction_rad=self.columns["heading_rad"][rows] if self.road.has_headings else None,
            vehicle_class=None if self.classes is None else self.classes[stay],
            **cast("dict[str, Any]", {name: values[rows] for name, values in self.columns.items()}),
        )


def assemble(read: ReadTraffic, path: Path, duration_s: float, start_s: float = 0.0) -> RecordedTraffic:
    """Bring a file's content onto the clock and cut it to the ``duration_s`` seconds from ``start_s`` on.

    Raises:
        InputError: The content contradicts itself, or has ended by ``start_s``.
    """
    if isinstance(read.road, CorridorRoad) and (problem := lanes_problem(read.road.lanes)):
        raise InputError(f"{path}: nobody can drive on its road: {problem}; fix it")
    stays = order_rows(read, path)
    check_units(stays, path)
    clocked = on_clock(stays)
    rows, accel = completed(clocked)
    order = np.argsort(clocked.step, kind="stable")
    first_step = round(start_s / STEP_S)
    steps = min(int(clocked.step.max()) + 1 - first_step, max(1, round(duration_s / STEP_S)))
    if steps < 1:
        raise InputError(
            f"traffic.recording.start_s: {path} ends after {clocked.step.max() * STEP_S:.1f} s; start earlier"
        )
    order = order[slice(*np.searchsorted(clocked.step[order], (first_step, first_step + steps)))]
    stay = clocked.stay[order]
    rows = rows.take(order)
    road, window_m, lane = _road_on_record(read.road, clocked, stay, rows)
    return RecordedTraffic(
        road=road,
        window_m=window_m,
        step_starts=np.searchsorted(clocked.step[order], first_step + np.arange(steps + 1)),
        stay=stay,
        names=stays.names,
        columns={name: getattr(rows, name) for name in FRAME_COLUMNS} | {"accel_mps2": accel[order]},
        lane=lane,
        counts=_counts(read, stays, stay, clocked.stay, clocked.filled),
        notes=_notes(stays),
        classes=None if read.classes is None else read.classes[stays.vehicle],
    )


def _road_on_record(
    road: Road, clocked: Clocked, stay: IntArray, rows: Rows
) -> tuple[Road, tuple[float, float], IntArray]:
    """Return the road, the stretch of it that is on record, and the lane of each row, shape (n,)."""
    match road:
        case CorridorRoad():
            window_m = recorded_window(clocked.step, clocked.stay, clocked.rows.lon_m)
            return replace(road, section_m=window_m), window_m, road.lane_number_at(rows.lon_m, rows.lat_m)
        case LaneGraphRoad(graph=graph):
            # Nobody knows where in the plane what is on record ends.
            return road, EVERYWHERE, 1 + lanes_driven(graph, stay, rows.lon_m, rows.lat_m, rows.heading_rad)
    raise TypeError(f"{type(road).__name__} is no kind of road that traffic is recorded on")


def check_one_road(traffic: RecordedTraffic, path: Path) -> None:
    """Refuse traffic of which no one road is known, where distances along it are needed.

    Raises:
        InputError: Its lanes lie in the plane.
    """
    if not traffic.road.lanes:
        raise InputError(f"{path}: its lanes lead several ways; give a recording of one road, such as a motorway's")


def recorded_window(step: IntArray, stay: IntArray, lon_m: FloatArray) -> tuple[float, float]:
    """Return the stretch of road on record: from where vehicles appear to where they vanish.

    An edge is where at least three vehicles appear (or vanish) within 5 m while the recording runs; without such place
    the outermost position is taken. A single vehicle that strays beyond does not move the edge, nor does one that is
    lost half-way.

    Args:
        step: Step of each row, shape (n,).
        stay: Stay of each row, sorted by stay and step, shape (n,).
        lon_m: Longitudinal position of each row, shape (n,).
    """
    first = np.flatnonzero(np.diff(stay, prepend=-1))
    last = np.append(first[1:], len(stay)) - 1
    appears_m = np.sort(lon_m[first[step[first] > step.min()]])
    vanishes_m = np.sort(lon_m[last[step[last] < step.max()]])
    start_m = _outermost_cluster(-appears_m[::-1], -float(lon_m.min()))
    end_m = _outermost_cluster(vanishes_m, float(lon_m.max()))
    return -start_m, max(end_m, -start_m + 1.0)


def _outermost_cluster(ascending_m: FloatArray, otherwise_m: float) -> float:
    """Return the largest position that has enough others just below it."""
    others = EDGE_VEHICLES - 1
    if len(ascending_m) <= others:
        return otherwise_m
    crowded = np.flatnonzero(ascending_m[others:] - ascending_m[:-others] <= EDGE_WIDTH_M)
    return float(ascending_m[others:][crowded[-1]]) if len(crowded) else otherwise_m


def _notes(stays: Stays) -> tuple[str, ...]:
    if not len(stays.jumps):
        return ()
    names = ", ".join(str(stays.names[stay - 1]) for stay in stays.jumps[:5])
    return (f"{len(stays.jumps)} jumps, after which a vehicle is taken as another one: {names}",)


def _counts(read: ReadTraffic, stays: Stays, used: IntArray, clocked: IntArray, filled: int) -> ReadingCounts:
    in_file = len(np.unique(stays.vehicle))
    on_clock_vehicles = len(np.unique(stays.vehicle[np.unique(clocked)]))
    kept = len(np.unique(stays.vehicle[np.unique(used)]))
    left_out = {reason: count for reason, count in read.left_out.items() if count}
    if in_file > on_clock_vehicles:
        left_out["on record between two steps only"] = in_file - on_clock_vehicles
    if on_clock_vehicles > kept:
        left_out["on record only outside of the seconds used"] = on_clock_vehicles - kept
    return ReadingCounts(
        vehicles_read=read.vehicles_read,
        vehicles_kept=kept,
        left_out=left_out,
        rows_kept=len(used),
        duplicates=stays.duplicates,
        contradictions=stays.contradictions,
        filled=filled,
    )
