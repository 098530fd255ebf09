"""Scores of vehicles hidden on purpose: the error when the time ends, and whether the identity was kept.

A window is the time for which the detections of one vehicle are withheld (``harness.sensor.pseudo_occlusion``). It
counts if the vehicle is in range at its end. The yardstick is the true state at the last detection, extrapolated at
constant velocity.
"""

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from harness.scoring.evidence.directions import along_and_across, along_axes
from harness.scoring.evidence.errors import TRACKED, scored_rows
from harness.scoring.evidence.events import row_after
from harness.scoring.evidence.matching import find_track_rows
from harness.scoring.evidence.rows import TruthRows
from harness.scoring.evidence.rules import EVENT_JUDGED_S, FOLLOW_CUTOFF_M, TIME_TOLERANCE_S
from harness.scoring.evidence.stretches import stretches
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import ROWS, of_any, of_whole
from harness.scoring.metrics.quantity import Quantity, of_kinds
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

NAME = "pseudo_occlusion"
USUAL_S = (1.0, 2.0, 3.0, 5.0)
SITUATIONS = ("following", "free", "turning", "changing_lanes")
LEADER_M, BESIDE_M = 40.0, 2.0
"""A vehicle follows another that is at most so far ahead and so far to the side."""
TURN_RAD, SIDEWAYS_M = 0.2, 2.0
"""Change of heading of a turn, and sideways motion of a change of lanes."""
CHI2_90 = 4.605
"""The 90 % quantile of chi-squared with two degrees of freedom."""
WINDOWS, FOLLOWED, JUDGED = "windows", "followed_windows", "judged_windows"
CONSTANT = "constant_velocity_total_m"
"""Numbers behind the scores."""


QUANTITIES = of_kinds(
    NAME, {f"{seconds:g}s": f"after {seconds:g}s hidden on purpose" for seconds in USUAL_S},
    Quantity("cost_m", "position error {} (10 m if lost), m", decimals=2, weight=WINDOWS, limit=FOLLOW_CUTOFF_M),
    Quantity("ratio", "the same over constant velocity {}", decimals=2, weight=CONSTANT),
    Quantity("same_id_percent", "same identity {}, %", True, weight=JUDGED),
    Quantity("ellipse90_percent", "90 % ellipse holds the truth {}, %", weight=FOLLOWED, best=90.0),
)  # fmt: skip


@dataclass(frozen=True)
class HiddenWindows:
    """The windows of a stretch, struct of arrays of shape (w,).

    Attributes:
        followed: The track that held the vehicle lives at the end and follows no other vehicle.
        error_m: Distance of that track from the vehicle then; nan where not followed.
        constant_m: Distance of the extrapolated true state from the vehicle then.
        in_ellipse: That track's 90 % ellipse contains the vehicle then.
        same_id: Half a second after the end that track is on the vehicle.
        judged: The vehicle is still in range then.
        situation: Index into ``SITUATIONS``.
    """

    length_s: FloatArray = field(metadata=ROWS)
    followed: BoolArray = field(metadata=ROWS)
    error_m: FloatArray = field(metadata=ROWS)
    constant_m: FloatArray = field(metadata=ROWS)
    in_ellipse: BoolArray = field(metadata=ROWS)
    same_id: BoolArray = field(metadata=ROWS)
    judged: BoolArray = field(metadata=ROWS)
    situation: IntArray = field(metadata=ROWS)


def measure_pseudo_occlusions(evidence: Evidence) -> HiddenWindows | None:
    """Return the windows of a stretch; None where no vehicle is hidden on purpose."""
    rows, matching, truth = evidence.rows, evidence.matching, evidence.rows.truth
    if truth.pseudo_hidden_s is None:
        return None
    first, last = _windows(truth, rows.time_s)
    onset = first - 1
    outcome = np.full(len(truth), -1)
    outcome[scored_rows(rows, evidence.history)] = evidence.errors.outcome
    followed = outcome[last] == TRACKED
    track = np.where(followed, matching.holder_row[last], 0)
    x, y, std_x, std_y = (
        np.append(values, 0.0)[track] if len(values) else np.zeros(len(track))
        for values in (rows.tracks.lon_m, rows.tracks.lat_m, rows.tracks.std_lon_m, rows.tracks.std_lat_m)
    )
    off_x, off_y = x - truth.lon_m[last], y - truth.lat_m[last]
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = (off_x / std_x) ** 2 + (off_y / std_y) ** 2 <= CHI2_90
    same_id, judged = _same_identity(evidence, onset, last)
    return HiddenWindows(
        length_s=truth.pseudo_hidden_s[first],
        followed=followed,
        error_m=np.where(followed, np.hypot(off_x, off_y), np.nan),
        constant_m=_constant_velocity_error(truth, onset, last),
        in_ellipse=followed & inside,
        same_id=same_id,
        judged=judged,
        situation=_situations(truth, onset, last),
    )


def _windows(truth: TruthRows, times: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the first and last row of each whole window whose vehicle is in range at its end, each shape (w,)."""
    length = truth.pseudo_hidden_s if truth.pseudo_hidden_s is not None else np.zeros(len(truth))
    # A new window of the same vehicle begins after at least one step in view.
    first, last = stretches(length > 0.0, truth.vehicle)
    step_s = float(np.min(np.diff(times))) if len(times) > 1 else 0.0
    whole = truth.time_s[last] - truth.time_s[first] + step_s >= length[first] - step_s + TIME_TOLERANCE_S
    whole &= (first > 0) & truth.in_range[last]
    whole[whole] = truth.vehicle[first[whole] - 1] == truth.vehicle[first[whole]]
    return first[whole], last[whole]


def _constant_velocity_error(truth: TruthRows, onset: IntArray, last: IntArray) -> FloatArray:
    """Return how far the true state at the onset, at constant velocity, ends from the vehicle, shape (w,)."""
    time_s = truth.time_s[last] - truth.time_s[onset]
    along_m, across_m = truth.speed_mps[onset] * time_s, truth.lat_speed_mps[onset] * time_s
    x, y = along_axes(along_m, across_m, truth.direction_rad[onset])
    off_x, off_y = truth.lon_m[onset] + x - truth.lon_m[last], truth.lat_m[onset] + y - truth.lat_m[last]
    return np.asarray(np.hypot(off_x, off_y))


def _same_identity(evidence: Evidence, onset: IntArray, last: IntArray) -> tuple[BoolArray, BoolArray]:
    rows, matching = evidence.rows, evidence.matching
    judged = row_after(rows, last, EVENT_JUDGED_S)
    known = (judged >= 0) & rows.truth.in_range[judged]
    old = matching.holder[onset]
    track = find_track_rows(rows, rows.truth.step[judged], old)
    on = np.append(matching.truth_row, -1)[track]
    return known & (track >= 0) & (on == judged), known


def _situations(truth: TruthRows, onset: IntArray, last: IntArray) -> IntArray:
    """Return what each vehicle does in its window, as indices into ``SITUATIONS``, shape (w,)."""
    turned = np.abs(np.angle(np.exp(1j * (truth.direction_rad[last] - truth.direction_rad[onset])))) > TURN_RAD
    _, sideways = along_and_across(
        truth.lon_m[last] - truth.lon_m[onset], truth.lat_m[last] - truth.lat_m[onset], truth.direction_rad[onset]
    )
    by_step = np.argsort(truth.step, kind="stable")
    begin = np.searchsorted(truth.step[by_step], truth.step[onset], side="left")
    end = np.searchsorted(truth.step[by_step], truth.step[onset], side="right")
    follows = np.zeros(len(onset), dtype=np.bool_)
    for window, row in enumerate(onset):
        others = by_step[begin[window] : end[window]]
        ahead, beside = along_and_across(
            truth.lon_m[others] - truth.lon_m[row],
            truth.lat_m[others] - truth.lat_m[row],
            np.full(len(others), truth.direction_rad[row]),
        )
        follows[window] = ((ahead > 0.5) & (ahead < LEADER_M) & (np.abs(beside) < BESIDE_M)).any()
    return np.where(turned, 2, np.where(np.abs(sideways) > SIDEWAYS_M, 3, np.where(follows, 0, 1)))


@of_whole
def scores_of_pseudo_occlusions(windows: HiddenWindows) -> dict[str, object]:
    """Return the scores of all windows, by their length and by situation.

    Returns:
        For ``all``, each length (``1s``) and each of ``SITUATIONS``: ``windows``; ``followed_percent``, those at whose
        end the track that held the vehicle lives and follows no other; ``error_m``, its mean distance then, and
        ``constant_velocity_m``, that of the true state at the last detection extrapolated at constant velocity, over
        the same ``followed_windows``, with its sum ``constant_velocity_total_m``; ``ratio`` of the two; ``cost_m``, the
        mean of ``error_m`` over all windows, 10 m at most and where no track follows; ``ellipse90_percent``, the
        followed ones whose 90 % ellipse contains the vehicle; ``same_id_percent``, those after which the same track is
        on the vehicle half a second later, of the ``judged_windows`` of vehicles still in range then. Empty where no
        vehicle is hidden on purpose.
    """
    everything = np.ones(len(windows.length_s), dtype=np.bool_)
    lengths = sorted({*USUAL_S, *windows.length_s.tolist()})
    table = {"all": _scores(windows, everything)}
    table |= {f"{length:g}s": _scores(windows, windows.length_s == length) for length in lengths}
    table |= {name: _scores(windows, windows.situation == index) for index, name in enumerate(SITUATIONS)}
    return dict(table)


def _scores(windows: HiddenWindows, chosen: BoolArray) -> dict[str, float]:
    followed = windows.followed & chosen
    error_m, constant_m = windows.error_m[followed], windows.constant_m[followed]
    mean = partial(of_any, np.mean)
    return {
        WINDOWS: int(chosen.sum()),
        FOLLOWED: int(followed.sum()),
        JUDGED: int((chosen & windows.judged).sum()),
        "followed_percent": 100.0 * mean(windows.followed[chosen]),
        "error_m": mean(error_m),
        "constant_velocity_m": mean(constant_m),
        CONSTANT: float(constant_m.sum()),
        "ratio": mean(error_m) / mean(constant_m) if len(error_m) and constant_m.sum() > 0.0 else np.nan,
        "cost_m": mean(np.fmin(windows.error_m[chosen], FOLLOW_CUTOFF_M)),  # nan where not followed
        "ellipse90_percent": 100.0 * mean(windows.in_ellipse[followed]),
        "same_id_percent": 100.0 * mean(windows.same_id[chosen & windows.judged]),
    }
