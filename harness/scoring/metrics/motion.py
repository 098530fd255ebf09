"""Quality of motion by visibility: smoothness of tracks, and errors of acceleration and heading.

A step counts if the same track followed the vehicle at the step before as well (and before that, for jerk).
"""

import numpy as np

from harness.scoring.evidence.errors import scored_rows
from harness.scoring.evidence.rules import TIME_TOLERANCE_S
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.mae import STATES
from harness.scoring.metrics.parts import of_whole, ratio
from harness.scoring.metrics.quantity import Quantity, of_kinds
from harness.storage.schema import HIDDEN
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

NAME = "motion"
LARGE_JUMP_M, MOVING_MPS, COURSE_S = 1.0, 2.0, 0.5
QUANTITIES = of_kinds(
    NAME, {"visible": ", visible", "hidden": ", hidden"},
    Quantity("jerk_mps3", "jerk of tracks, root mean square{}, m/s³", decimals=2, weight="jerk_n", is_root=True),
    Quantity("jump_m", "change of a track's position error from step to step{}, m", decimals=2, weight="n"),
    Quantity(
        "large_jumps_percent", "steps at which the position error changes by more than 1 m{}, %",
        decimals=2, weight="n",
    ),
    Quantity("accel_mps2", "acceleration error{}, m/s²", decimals=2, weight="accel_n"),
    Quantity("heading_deg", "heading error of moving vehicles{}, °", decimals=2, weight="heading_n"),
)  # fmt: skip
MEASURED = ("jerk", "true_jerk", "jump", "large", "accel", "heading")


def measure_motion(evidence: Evidence) -> FloatArray:
    """Return sum and number of each of ``MEASURED`` in a stretch for each of ``STATES``, shape (4, 6, 2)."""
    rows, errors, matching = evidence.rows, evidence.errors, evidence.matching
    kept, truth, tracks = scored_rows(rows, evidence.history), rows.truth, rows.tracks
    followed = np.where(errors.state == HIDDEN, matching.holder_row[kept], matching.track_row[kept])
    chosen = errors.tracked
    kept, followed, state = kept[chosen], followed[chosen], errors.state[chosen]
    order = np.lexsort((truth.step[kept], truth.vehicle[kept]))
    kept, followed, state = kept[order], followed[order], state[order]
    again = np.zeros(len(kept), dtype=bool)
    again[1:] = (
        np.equal(np.diff(truth.vehicle[kept]), 0)
        & np.equal(np.diff(tracks.track[followed]), 0)
        & np.equal(np.diff(truth.step[kept]), 1)
    )
    third = again & np.append(False, again)[:-1]
    step_s = np.where(again, _difference(truth.time_s[kept]), np.nan)

    def jerk_of(speed: FloatArray) -> FloatArray:
        return _difference(_difference(speed) / step_s) / step_s

    jump = np.hypot(
        _difference(tracks.lon_m[followed] - truth.lon_m[kept]), _difference(tracks.lat_m[followed] - truth.lat_m[kept])
    )
    turn = np.arctan2(tracks.lat_speed_mps[followed], tracks.speed_mps[followed])
    turn = turn - np.arctan2(truth.lat_speed_mps[kept], truth.speed_mps[kept])
    if rows.has_headings:  # there tracks state no direction
        before = _places_before(truth.time_s[kept], again)
        turn = _way(tracks.lon_m[followed], tracks.lat_m[followed], before)
        turn = turn - _way(truth.lon_m[kept], truth.lat_m[kept], before)
    turn = np.abs(np.mod(turn + np.pi, 2.0 * np.pi) - np.pi)
    moves = truth.speed_mps[kept] >= MOVING_MPS
    accel = np.full(len(kept), np.nan)
    if truth.accel_mps2 is not None and tracks.accel_mps2 is not None:
        accel = np.abs(tracks.accel_mps2[followed] - truth.accel_mps2[kept])
    values: list[tuple[FloatArray, BoolArray]] = [
        (jerk_of(tracks.speed_mps[followed]) ** 2, third), (jerk_of(truth.speed_mps[kept]) ** 2, third),
        (jump, again), (np.where(jump > LARGE_JUMP_M, 100.0, 0.0), again), (accel, again),
        (np.degrees(turn), again & moves),
    ]  # fmt: skip
    table = np.zeros((len(STATES), len(MEASURED), 2))
    for place, codes in enumerate(STATES.values()):
        for which, (value, counts) in enumerate(values):
            own = value[counts & np.isin(state, codes) & np.isfinite(value)]
            table[place, which] = own.sum(), len(own)
    return table


@of_whole
def quality_of_motion(total: FloatArray) -> dict[str, object]:
    """Return the scores of all vehicles and by visibility.

    Returns:
        For each of ``STATES``: ``jerk_mps3``, root mean square of the second difference of a track's speed by time,
        and ``true_jerk_mps3`` of the vehicles followed; ``jump_m``, mean length of the change of a track's position
        error from one step to the next, and ``large_jumps_percent``, the share above 1 m; ``accel_mps2``, mean absolute
        error of the acceleration that a track states; ``heading_deg``, that of the direction of its speed, in the plane
        of its way over the last ``COURSE_S``, of vehicles at 2 m/s or more; ``n``, vehicle-steps,
        and those of which acceleration, heading and jerk are known, such as ``jerk_n``. nan for nothing.
    """
    table: dict[str, object] = {}
    for name, sums in zip(STATES, total, strict=True):
        mean = {each: ratio(*pair) for each, pair in zip(MEASURED, sums.tolist(), strict=True)}
        table[name] = {
            "jerk_mps3": float(np.sqrt(mean["jerk"])), "true_jerk_mps3": float(np.sqrt(mean["true_jerk"])),
            "jump_m": mean["jump"], "large_jumps_percent": mean["large"], "accel_mps2": mean["accel"],
            "heading_deg": mean["heading"], "n": int(sums[MEASURED.index("jump"), 1]),
            **{f"{each}_n": int(sums[MEASURED.index(each), 1]) for each in ("jerk", "accel", "heading")},
        }  # fmt: skip
    return table


def _difference(values: FloatArray) -> FloatArray:
    """Return each value less the one before it, nan for the first, shape (n,)."""
    return np.diff(values, prepend=np.nan)


def _way(lon_m: FloatArray, lat_m: FloatArray, before: IntArray) -> FloatArray:
    """Return the directions from earlier places to each place, radians; nan without an earlier one."""
    return np.where(before >= 0, np.arctan2(lat_m - lat_m[before], lon_m - lon_m[before]), np.nan)


def _places_before(time_s: FloatArray, again: BoolArray) -> IntArray:
    """Return the last place, at least ``COURSE_S`` earlier, in an unbroken row of places; -1 where none is.

    Args:
        time_s: Time of each place, ascending in each row, shape (n,).
        again: Whether a place goes on with the row of the one before, shape (n,).
    """
    row = np.cumsum(~again)
    key = row * (np.ptp(time_s) + 2.0 * COURSE_S if len(time_s) else 1.0) + time_s
    before = np.searchsorted(key, key - COURSE_S + TIME_TOLERANCE_S, side="right") - 1
    return np.where((before >= 0) & (row[before] == row), before, -1)
