"""The rows that every reader returns: recorded positions in the road frame, as in the file.

Where the road frame is the plane, headings count from the x axis, and speeds are along and across the own heading.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import numpy.typing as npt

from harness.common.bounds import TURNED_RAD, row_number
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, IntArray, StringArray, taken, wrapped

CHUNK_ROWS = 100_000
Selection = npt.NDArray[np.bool_] | IntArray


@dataclass(frozen=True)
class Rows:
    """Vehicle-times by the file's own clock, places are of middles, arrays of shape (n,); nan if not stated."""

    vehicle: IntArray
    time_s: FloatArray
    lon_m: FloatArray
    lat_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    lat_speed_mps: FloatArray
    length_m: FloatArray
    width_m: FloatArray

    def __len__(self) -> int:
        return len(self.vehicle)

    def take(self, rows: Selection) -> Self:
        """Return the chosen rows."""
        return taken(self, rows)


@dataclass(frozen=True)
class ReadTraffic:
    """A file's content.

    Attributes:
        vehicles_read: How many vehicles the file has, those that were left out among them.
        classes: Code of the class of each named vehicle (``mmpf.scan.VEHICLE_CLASSES``), shape (names,); None if the
            file tells none.
    """

    road: Road
    names: StringArray
    rows: Rows
    vehicles_read: int
    left_out: Mapping[str, int] = field(default_factory=dict)
    classes: IntArray | None = None

    @property
    def in_plane(self) -> bool:
        """Whether the road frame is the plane."""
        return self.road.has_headings


def rows_in(
    road: Road,
    origin_xy: tuple[float, float],
    vehicle: IntArray,
    time_s: FloatArray,
    place: tuple[FloatArray, FloatArray, FloatArray],
    speed_mps: FloatArray,
    size_m: tuple[FloatArray, FloatArray],
) -> Rows:
    """Return vehicle-times that are known in the Cartesian plane in a road's frame.

    Lateral speeds stay unknown: lanes' directions scatter too much for the drift to follow from the heading.

    Args:
        road: The road.
        origin_xy: Coordinates of the origin of its plane.
        vehicle: Index into the names, shape (n,), n at least 1.
        time_s: Times, shape (n,).
        place: x and y of the centres and headings, each (n,).
        speed_mps: Speeds along the headings, shape (n,).
        size_m: Lengths and widths, each (n,).

    Raises:
        ValueError: A direction is beyond a turn, or not finite.
    """
    x, y, direction = place[0] - origin_xy[0], place[1] - origin_xy[1], place[2]
    TURNED_RAD.check("the direction", direction, row_number)
    # Of a bent road as many pieces at a time as fit in memory.
    parts = [road.to_road(x[k : k + CHUNK_ROWS], y[k : k + CHUNK_ROWS]) for k in range(0, len(x), CHUNK_ROWS)]
    lon_m, lat_m = np.concatenate(parts, axis=1)
    heading = wrapped(direction - road.heading_at(lon_m))
    speed_mps = speed_mps * np.cos(heading - road.axis_of(heading))
    return Rows(vehicle, time_s, lon_m, lat_m, heading, speed_mps, unknown(len(x)), *size_m)


def unknown(count: int) -> FloatArray:
    """Return a column that the file does not have, shape (count,)."""
    return np.full(count, np.nan)
