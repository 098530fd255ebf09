"""Sorts rows, removes duplicates, and splits a vehicle's rows where its recording pauses or jumps."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.common.bounds import LEAP_M, LEAP_MPS, OF_THINGS, TURNED_RAD, Numbers, check_moves, check_numbers
from harness.common.errors import InputError
from harness.truth.recorded.rows import ReadTraffic, Rows
from mmpf.numerics.arrays import IntArray, StringArray

# Times closer together than this are one time.
TIME_RESOLUTION_S = 1e-3
# A name that comes up again after this long, forward or backward, is another vehicle: counting began anew.
NAME_USED_AGAIN_S = 60.0
UNITS = "fix or remove the row, or its unit"
# A pause of up to this long is filled in, a longer one ends a stay.
LONGEST_PAUSE_S = 1.0
SAME_POSITION_M = 0.05
# More of them than that, as a share of the rows, and the times are not the vehicles' own.
MOST_CONTRADICTING = 0.1
LONGEST_INTERVAL_S = 10.0
MOST_ROWS = 50_000_000
ROWS = OF_THINGS | {
    "time since the first row": Numbers(0.0, 400.0 * 86_400.0),
    "length_m": Numbers(1.0, 40.0),
    "width_m": Numbers(0.2, 10.0),
}
"""What a row of traffic of any format may hold; else a unit is wrong."""
# So many contradictions are those of a large recording, not of a wrong unit.
TOLERATED_SHARE = 0.01


@dataclass(frozen=True)
class Stays:
    """Rows in order, and where each stay of a vehicle begins in them.

    Attributes:
        rows: The rows, sorted by stay and time; their ``vehicle`` is the stay.
        names: Unique name of each stay, shape (s,): the vehicle's, from its second stay on with a number.
        interval_s: Usual time between two rows of a vehicle.
        contradictions: How many of them gave another position.
    """

    rows: Rows
    starts: IntArray
    vehicle: IntArray
    names: StringArray
    interval_s: float
    duplicates: int
    contradictions: int
    jumps: IntArray
    in_plane: bool

    @property
    def ends(self) -> IntArray:
        """Row after the last one of each stay, shape (s,)."""
        return np.append(self.starts[1:], len(self.rows))


def order_rows(traffic: ReadTraffic, path: Path) -> Stays:
    """Sort the rows by vehicle and time, without duplicates.

    Of several rows of one vehicle and time the file's first counts.

    Raises:
        InputError: A number is missing, a vehicle's time goes back, or it moves as nothing does.
    """
    rows = traffic.rows
    if not len(rows):
        raise InputError(f"{path}: it contains no vehicle; give a recording with vehicles")
    told = {"time since the first row": rows.time_s - rows.time_s.min(), **vars(rows)}
    allowed = ROWS | ({"heading_rad": TURNED_RAD} if traffic.in_plane else {})
    check_numbers(path, told, allowed, lambda row: f"vehicle {traffic.names[rows.vehicle[row]]}", UNITS)
    tick = np.round((rows.time_s - rows.time_s.min()) / TIME_RESOLUTION_S).astype(np.int64)
    key = rows.vehicle * (int(tick.max()) + 1) + tick
    order = np.argsort(key, kind="stable")
    repeated = np.zeros(len(order), dtype=bool)
    repeated[1:] = key[order][1:] == key[order][:-1]
    contradictions = _count_contradictions(rows, order, repeated)
    if contradictions > MOST_CONTRADICTING * len(rows):
        raise InputError(
            f"{path}: {contradictions} of {len(rows)} rows put a vehicle at two places at once; fix the times"
        )
    kept = order[~repeated]
    _check_time(rows.take(np.sort(kept)), traffic.names, path)
    rows = rows.take(kept)
    heading = rows.heading_rad if traffic.in_plane else np.zeros(len(rows))
    check_moves(path, traffic.names[rows.vehicle], rows.time_s, rows.lon_m, rows.lat_m, heading)
    step_s = np.diff(rows.time_s)
    same = np.diff(rows.vehicle) == 0
    interval_s = float(np.median(step_s[same])) if same.any() else 0.1
    if interval_s > LONGEST_INTERVAL_S:
        raise InputError(
            f"{path}: rows of a vehicle are {interval_s:g} s apart; give a recording with a row every "
            f"{LONGEST_INTERVAL_S:g} s or more often"
        )
    moved_m = np.hypot(np.diff(rows.lon_m), np.diff(rows.lat_m))
    pauses = step_s > max(LONGEST_PAUSE_S, 1.5 * interval_s)
    # One that leaps is taken as another one from there on.
    jumps = np.append(False, same & ~pauses & (moved_m > LEAP_MPS * step_s + LEAP_M))
    begins = np.append(True, ~same | pauses) | jumps
    starts = np.flatnonzero(begins)
    return Stays(
        rows=replace(rows, vehicle=np.cumsum(begins) - 1),
        starts=starts,
        vehicle=rows.vehicle[starts],
        names=_stay_names(traffic.names, rows.vehicle[starts]),
        interval_s=interval_s,
        duplicates=int(repeated.sum()),
        contradictions=contradictions,
        jumps=np.flatnonzero(jumps[starts]),
        in_plane=traffic.in_plane,
    )


def _count_contradictions(rows: Rows, order: IntArray, repeated: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> int:
    again = np.flatnonzero(repeated)
    off_m = np.hypot(
        rows.lon_m[order[again]] - rows.lon_m[order[again - 1]], rows.lat_m[order[again]] - rows.lat_m[order[again - 1]]
    )
    return int((off_m > SAME_POSITION_M).sum())


def _check_time(rows: Rows, names: StringArray, path: Path) -> None:
    """Refuse time that goes back from one row of a vehicle to its next one in the file."""
    step_s = np.diff(rows.time_s)
    back = (np.diff(rows.vehicle) == 0) & (step_s < 0.0) & (step_s > -NAME_USED_AGAIN_S)
    if back.any():
        row = int(np.flatnonzero(back)[0])
        raise InputError(
            f"{path}: the time of vehicle {names[rows.vehicle[row]]} goes back from {rows.time_s[row]:.2f} s to "
            f"{rows.time_s[row + 1]:.2f} s; sort the rows by vehicle and time, and check the time column"
        )


def _stay_names(names: StringArray, vehicle: IntArray) -> StringArray:
    first = np.maximum.accumulate(np.where(np.diff(vehicle, prepend=-1) != 0, np.arange(len(vehicle)), 0))
    number = np.arange(len(vehicle)) - first + 1
    numbered = zip(names[vehicle].tolist(), number.tolist(), strict=True)
    return np.array([name if count == 1 else f"{name}-{count}" for name, count in numbered])
