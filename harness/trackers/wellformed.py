"""Checks on external trackers: an exception becomes one line, and every result is validated."""

import inspect
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields
from pathlib import Path

import numpy as np

from harness.common.error_text import what_it_raised
from harness.common.errors import RunError
from harness.common.exit_codes import INTERNAL
from harness.common.signals import told_to_end
from harness.common.streams import streams_and_depth_kept
from mmpf.tracks import TRACK_STATES, Tracks

MOST_TRACKS = 10_000
FARTHEST, FASTEST = 1e7, 1e4
# Smallest and largest value of each column; deviations are above the smallest.
BOUNDS = {
    "track_id": (0, 2**53), "lon_m": (-FARTHEST, FARTHEST), "lat_m": (-FARTHEST, FARTHEST),
    "speed_mps": (-FASTEST, FASTEST), "lat_speed_mps": (-FASTEST, FASTEST), "accel_mps2": (-FARTHEST, FARTHEST),
    "std_lon_m": (0.0, FARTHEST), "std_lat_m": (0.0, FARTHEST), "std_speed_mps": (0.0, FARTHEST),
    "existence": (0.0, 1.0), "state": (0, len(TRACK_STATES) - 1),
}  # fmt: skip
MAY_BE_UNKNOWN = frozenset({"speed_mps", "lat_speed_mps", "accel_mps2", "std_speed_mps"})
FIRST_FORK, _first = os.pipe()
"""Holds one byte. The fork that reads it is the one that tells: a tracker may fork at every step."""
os.write(_first, b"1")
os.close(_first)


@contextmanager
def blamed_on(tracker: object, when: str) -> Iterator[None]:
    """Turn whatever a tracker raises, to leave the program too, into an error that names it, and end forks of its.

    Raises:
        RunError: It raised something.
    """
    owner = os.getpid()
    try:
        with streams_and_depth_kept():
            yield
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt | RunError) or told_to_end():
            raise
        raise RunError(f"the tracker {described(tracker)} failed {when}: {what_it_raised(error)}") from error
    finally:
        if os.getpid() != owner:
            if os.read(FIRST_FORK, 1):
                # In one piece with its end, so that no other process writes in between.
                told = f"the tracker {described(tracker)} has forked this process {when}; the copy ends here\n"
                os.write(2, told.encode())
            os._exit(INTERNAL)


def described(tracker: object) -> str:
    """Return a tracker's class, and where that is written."""
    kind = type(tracker)
    with suppress(OSError, TypeError):
        return f"{kind.__name__} ({Path(inspect.getfile(kind)).name} line {inspect.getsourcelines(kind)[1]})"
    return kind.__name__


def is_own(tracker: object) -> bool:
    """Return whether a tracker comes with this project."""
    return type(tracker).__module__.partition(".")[0] in ("harness", "mmpf")


def fault_of(tracks: object) -> str | None:
    """Return a sentence on the fault in a step's result, or None if it can be recorded and scored."""
    if not isinstance(tracks, Tracks):
        return f"step returned {type(tracks).__name__}, not Tracks"
    wanted = np.shape(tracks.track_id)
    for column in fields(Tracks):
        fault = _fault_of_column(column.name, getattr(tracks, column.name), wanted)
        if fault is not None:
            return f"{column.name} {fault}"
    if len(tracks) > MOST_TRACKS:
        return f"there are {len(tracks)} tracks; {MOST_TRACKS} are the most"
    return "two tracks have one identity" if len(np.unique(tracks.track_id)) < len(tracks) else None


def _fault_of_column(name: str, values: object, wanted: tuple[int, ...]) -> str | None:
    if not isinstance(values, np.ndarray) or isinstance(values, np.ma.MaskedArray):
        return f"is {type(values).__name__}, not an array"
    if values.shape != wanted or values.ndim != 1:
        return f"has shape {values.shape}, track_id {wanted}; both must be (m,)"
    is_whole = name in ("track_id", "state")
    if values.dtype.kind not in ("iu" if is_whole else "fiu"):
        return f"is {values.dtype}, not {'whole ' * is_whole}numbers"
    low, high = BOUNDS[name]
    values = np.asarray(values, None if is_whole else np.float64)  # to float16 the bounds are infinite
    right = (values > low if name.startswith("std_") else values >= low) & (values <= high)
    if name in MAY_BE_UNKNOWN:
        right |= np.isnan(values)
    if right.all():
        return None
    return f"holds {values[~right][0]:g}; it must be {'above ' * name.startswith('std_')}{low:g} to {high:g}"
