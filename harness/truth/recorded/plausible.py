"""Refuses what cannot be one recording in one system of units."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.errors import UserError
from harness.truth.recorded.order import Stays
from mmpf.road import FloatArray

# Vehicles that move or drive less than this say nothing about units.
TELLING_DISTANCE_M = 10.0
# Metres read as feet give 0.30, feet read as metres 3.28, degrees or centimetres far more or less.
BELIEVABLE_RATIO = (0.5, 2.0)
LENGTH_RANGE_M = (1.0, 40.0)
USUAL_LENGTH_RANGE_M = (2.5, 20.0)
JUMP_MPS = 80.0
SIZE_CHANGE_RATIO = 2.0


def check_units(stays: Stays, path: Path) -> None:
    """Refuse positions, speeds and sizes that contradict each other.

    Raises:
        UserError: A vehicle moves much farther or less far than its speed says, jumps, changes its size, or is no
            vehicle's size: units are mixed or not those of the format.
    """
    _check_sizes(stays, path)
    _check_jumps(stays, path)
    _check_speeds(stays, path)


def _check_sizes(stays: Stays, path: Path) -> None:
    length_m = stays.rows.length_m
    longest = np.maximum.reduceat(length_m, stays.starts)
    shortest = np.minimum.reduceat(length_m, stays.starts)
    changing = np.flatnonzero(longest > SIZE_CHANGE_RATIO * np.maximum(shortest, 1e-9))
    if len(changing):
        stay = changing[0]
        raise UserError(
            f"{path}: vehicle {stays.names[stay]} is {shortest[stay]:.2f} and {longest[stay]:.2f} m long: mixed units?"
        )
    wrong = np.flatnonzero((longest < LENGTH_RANGE_M[0]) | (longest > LENGTH_RANGE_M[1]))
    if len(wrong):
        stay = wrong[0]
        raise UserError(f"{path}: vehicle {stays.names[stay]} would be {longest[stay]:.2f} m long: wrong units?")
    usual_m = float(np.median(longest))
    if len(longest) >= 3 and not USUAL_LENGTH_RANGE_M[0] <= usual_m <= USUAL_LENGTH_RANGE_M[1]:
        raise UserError(f"{path}: half of the vehicles would be no longer than {usual_m:.2f} m: wrong units?")


def _check_jumps(stays: Stays, path: Path) -> None:
    rows = stays.rows
    step_s = np.diff(rows.time_s)
    moved_m = np.hypot(np.diff(rows.lon_m), np.diff(rows.lat_m))
    jumps = np.flatnonzero((np.diff(rows.vehicle) == 0) & (moved_m > JUMP_MPS * step_s + 1.0))
    if len(jumps):
        row = jumps[0]
        raise UserError(
            f"{path}: vehicle {stays.names[rows.vehicle[row]]} jumps by {moved_m[row]:.1f} m in {step_s[row]:.2f} s "
            f"at {rows.time_s[row]:.1f} s: mixed units or two vehicles of one name?"
        )


def _check_speeds(stays: Stays, path: Path) -> None:
    rows = stays.rows
    same = np.diff(rows.vehicle) == 0
    step_s = np.where(same, np.diff(rows.time_s), 0.0)
    driven_m = 0.5 * (np.abs(rows.speed_mps[1:]) + np.abs(rows.speed_mps[:-1])) * step_s
    moved_m = np.where(same, np.abs(np.diff(rows.lon_m)), 0.0)
    driven, moved = _sum_by_stay(driven_m, stays), _sum_by_stay(moved_m, stays)
    telling = np.isfinite(driven) & (np.maximum(driven, moved) > TELLING_DISTANCE_M)
    ratio = np.where(telling, moved / np.maximum(driven, 1e-6), 1.0)
    wrong = np.flatnonzero((ratio < BELIEVABLE_RATIO[0]) | (ratio > BELIEVABLE_RATIO[1]))
    if len(wrong):
        stay = wrong[0]
        raise UserError(
            f"{path}: vehicle {stays.names[stay]} moves {moved[stay]:.1f} m while its speed says {driven[stay]:.1f} m: "
            "mixed or wrong units?"
        )


def _sum_by_stay(values: FloatArray, stays: Stays) -> FloatArray:
    """Sum what lies between rows; what lies between stays must be 0."""
    return np.asarray(np.add.reduceat(np.append(values, 0.0), stays.starts))
