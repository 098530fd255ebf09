"""Refuses rows that cannot be one recording in one system of units."""

from pathlib import Path

import numpy as np

from harness.common.errors import InputError
from harness.truth.recorded.order import TOLERATED_SHARE, Stays
from mmpf.numerics.arrays import FloatArray

# Vehicles that move or drive less than this say nothing about units.
TELLING_DISTANCE_M = 10.0
# Metres read as feet give 0.30, feet read as metres 3.28, degrees or centimetres far more or less.
BELIEVABLE_RATIO = (0.5, 2.0)
USUAL_LENGTH_RANGE_M = (2.5, 20.0)
# Foot, kilometre per hour and mile per hour against metre and metre per second, either way.
UNIT_FACTORS = np.array([0.3048, 1.0 / 0.3048, 3.6, 1.0 / 3.6, 0.44704, 1.0 / 0.44704])
SAME_FACTOR = 0.03
SIZE_CHANGE_RATIO, LONGEST_NAME = 2.0, 200
# Boxes of vehicles side by side touch by errors of measurement; so deep within one another few ever are.
DEEP_SHARE, MOST_WITHIN = 0.8, 0.05


def check_units(stays: Stays, path: Path) -> None:
    """Refuse positions, speeds and sizes that contradict each other.

    Raises:
        InputError: Vehicles move much farther or less far than their speed says, change their size, or are
            of no vehicle's size: units are mixed or not those of the format.
    """
    if (longest := max(map(len, stays.names))) > LONGEST_NAME:
        raise InputError(f"{path}: a vehicle's name has {longest} letters; at most {LONGEST_NAME} are read")
    _check_sizes(stays, path)
    _check_speeds(stays, path)
    _check_apart(stays, path)


def _check_sizes(stays: Stays, path: Path) -> None:
    for size_m, how in ((stays.rows.width_m, "wide"), (stays.rows.length_m, "long")):
        longest, shortest = (of.reduceat(size_m, stays.starts) for of in (np.maximum, np.minimum))
        changing = np.flatnonzero(longest > SIZE_CHANGE_RATIO * np.maximum(shortest, 1e-9))
        if len(changing):
            name, least, most = stays.names[changing[0]], shortest[changing[0]], longest[changing[0]]
            raise InputError(f"{path}: vehicle {name} is {least:.2f} and {most:.2f} m {how}: mixed units?")
    usual_m = float(np.median(longest))
    if len(longest) >= 3 and not USUAL_LENGTH_RANGE_M[0] <= usual_m <= USUAL_LENGTH_RANGE_M[1]:
        raise InputError(f"{path}: half of the vehicles would be no longer than {usual_m:.2f} m: wrong units?")


def _check_speeds(stays: Stays, path: Path) -> None:
    """Refuse vehicles that move much farther or less far than their speed says, or the other way."""
    rows = stays.rows
    same = np.diff(rows.vehicle) == 0
    step_s = np.where(same, np.diff(rows.time_s), 0.0)
    driven = _sum_by_stay(0.5 * (rows.speed_mps[1:] + rows.speed_mps[:-1]) * step_s, stays)
    moved = _sum_by_stay(np.where(same, _ahead_m(stays), 0.0), stays)
    telling = np.isfinite(driven) & (np.maximum(np.abs(driven), np.abs(moved)) > TELLING_DISTANCE_M)
    ratio = np.where(telling, moved / np.where(np.abs(driven) > 1e-6, driven, 1e-6), 1.0)
    wrong = np.flatnonzero((ratio < BELIEVABLE_RATIO[0]) | (ratio > BELIEVABLE_RATIO[1]))
    # Contradictions that are many or that a wrong unit explains; a large recording has a few of other kinds.
    by_unit = np.abs(np.log(np.maximum(ratio[wrong], 1e-9))[:, None] - np.log(UNIT_FACTORS)).min(axis=1) < SAME_FACTOR
    if suspects := wrong[by_unit | (len(wrong) > TOLERATED_SHARE * len(stays.starts))].tolist():
        told = f"moves {moved[suspects[0]]:+.1f} m while its speed says {driven[suspects[0]]:+.1f} m"
        raise InputError(f"{path}: vehicle {stays.names[suspects[0]]} {told}: mixed or wrong units?")


def _check_apart(stays: Stays, path: Path) -> None:
    """Refuse a road where many vehicles are within others, as where one of the two coordinates has another unit."""
    rows = stays.rows
    if stays.in_plane:
        return
    order = np.lexsort((rows.lon_m, rows.time_s))
    time_s, lon_m, lat_m, length_m, width_m = (
        values[order] for values in (rows.time_s, rows.lon_m, rows.lat_m, rows.length_m, rows.width_m)
    )
    within = (
        (np.diff(time_s) == 0.0)
        & (np.diff(lon_m) < 0.5 * DEEP_SHARE * (length_m[1:] + length_m[:-1]))
        & (np.abs(np.diff(lat_m)) < 0.5 * DEEP_SHARE * (width_m[1:] + width_m[:-1]))
    )
    # A single pair may be two things that a file has in one place, such as a vehicle that is parked where another is.
    if np.mean(within) > MOST_WITHIN and len(np.unique(rows.vehicle[order[1:][within]])) > 1:
        first = int(within.argmax())
        one, other = (stays.names[rows.vehicle[order[k]]] for k in (first, first + 1))
        raise InputError(
            f"{path}: vehicles {one} and {other} are in one place at {time_s[first]:.1f} s, and so are others in "
            f"{100.0 * np.mean(within):.0f} % of the rows: wrong units of a coordinate?"
        )


def _ahead_m(stays: Stays) -> FloatArray:
    """Return how far each row's vehicle is ahead in the next row: along the road, or as it points in the plane."""
    rows = stays.rows
    if not stays.in_plane:
        return np.diff(rows.lon_m)
    heading = rows.heading_rad[:-1]
    return np.asarray(np.diff(rows.lon_m) * np.cos(heading) + np.diff(rows.lat_m) * np.sin(heading))


def _sum_by_stay(values: FloatArray, stays: Stays) -> FloatArray:
    """Sum what lies between rows; what lies between stays must be 0."""
    return np.asarray(np.add.reduceat(np.append(values, 0.0), stays.starts))
