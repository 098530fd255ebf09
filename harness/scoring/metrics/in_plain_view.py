"""Which vehicles in plain view have no track: recall, time to the first report, drops, and who they are.

Truth alone says who is asked for (``plain_view``), so a vehicle that the sensor rarely detects counts in full. A
vehicle has a track where a reported one is matched to it by ``matching``: within the gate, one to one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from harness.scoring.evidence.plain_view import begins, lasting_s
from harness.scoring.evidence.rows import TruthRows
from harness.scoring.evidence.rules import PLAIN_VIEW_M, TIME_TOLERANCE_S
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import ROWS, of_any, of_whole, ratio
from harness.scoring.metrics.quantity import Quantity
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

NAME = "in_plain_view"
RECALL, WORST_TENTH = f"{NAME}.recall", f"{NAME}.worst_tenth"
NEVER_REPORTED, DROPPED = "never reported", "dropped"
MOST_LISTED = 20
RANKED_S, WORST_SHARE = 1.0, 0.1
"""Shortest time in plain view of a vehicle that is ranked or never reported; share of the vehicles that are worst."""
DROPPED_S = 0.5
"""Shortest time in plain view without its track of a vehicle that is dropped."""
STANDING_MPS, STANDING_S, FLOWING_MPS = 0.5, 2.0, 5.0
"""A vehicle slower than the first for so long, where the others are faster than the last, is stopped amid traffic."""
VEHICLES = f"{NAME}.vehicles_n"
QUANTITIES = (
    Quantity(RECALL, "in plain view with a track, %", True, heading="plain view %", weight=f"{NAME}.n"),
    Quantity(
        WORST_TENTH, "in plain view with a track, worst tenth of vehicles, %", True,
        heading="worst tenth %", weight=f"{NAME}.worst_n",
    ),
    Quantity(
        f"{NAME}.median_first_report_s", "time in plain view to the first report, median, s",
        decimals=2, weight=VEHICLES,
    ),
    Quantity(
        f"{NAME}.p90_first_report_s", "time in plain view to the first report, 90th percentile, s",
        decimals=2, weight=VEHICLES,
    ),
    Quantity(f"{NAME}.never_reported", "vehicles in plain view never reported", is_counted=True),
    Quantity(f"{NAME}.dropped", "tracks dropped in plain view", is_counted=True),
    Quantity(
        f"{NAME}.stopped_recall", "stopped amid traffic, in plain view with a track, %", True,
        heading="stopped %", weight=f"{NAME}.stopped_n",
    ),
)  # fmt: skip


@dataclass(frozen=True)
class PlainViewPart:
    """Tracks of vehicles in plain view in one part of a run, arrays of shape (vehicles,) unless stated otherwise.

    Attributes:
        counted: Vehicle-steps asked for, which stand for ``counted_s``; ``followed`` of them with a track.
        view_s: Time in plain view near the ego.
        first_s: Time in plain view near the ego before the first report there, all of it where there is none.
        reported: Whether it was ever reported there.
        drops: How often its track was dropped.
        stopped: Vehicle-steps asked for of vehicles stopped amid traffic; ``stopped_followed`` of them with a track.
        losses: The worst vehicles never reported or dropped, as in ``vehicles``, of shape (at most 20,).
    """

    stopped: int
    stopped_followed: int
    counted: IntArray = field(metadata=ROWS)
    followed: IntArray = field(metadata=ROWS)
    counted_s: FloatArray = field(metadata=ROWS)
    view_s: FloatArray = field(metadata=ROWS)
    first_s: FloatArray = field(metadata=ROWS)
    reported: BoolArray = field(metadata=ROWS)
    drops: IntArray = field(metadata=ROWS)
    losses: list[dict[str, Any]] = field(metadata=ROWS)


@dataclass(frozen=True)
class _Spans:
    """Times in plain view near the ego in which a vehicle has a track throughout, or none; shape (k,)."""

    of_row: IntArray
    first: IntArray
    followed: BoolArray
    fresh: BoolArray
    lasts_s: FloatArray


def measure_plain_view(evidence: Evidence) -> PlainViewPart:
    """Measure a stretch."""
    truth, plain = evidence.rows.truth, evidence.plain
    followed = evidence.matching.track_row >= 0
    size = len(plain.names)
    near = np.flatnonzero(plain.near)
    spans = _spans(near, truth, followed, plain.near, plain.step_s)

    def by_vehicle(rows: IntArray) -> IntArray:
        return np.bincount(truth.vehicle[rows], minlength=size).astype(np.int64)

    def seconds(rows: IntArray) -> FloatArray:
        return np.bincount(truth.vehicle[rows], plain.step_s[rows], minlength=size).astype(np.float64)

    counted = np.flatnonzero(plain.counted)
    stopped = np.flatnonzero(plain.counted & stopped_amid_traffic(truth, plain.away_m))
    reports = near[followed[near]]
    first_report = np.full(size, len(truth))
    np.minimum.at(first_report, truth.vehicle[reports], reports)
    view_s = seconds(near)
    dropped = ~spans.followed & ~spans.fresh & (spans.lasts_s >= DROPPED_S - TIME_TOLERANCE_S)
    reported = first_report < len(truth)
    never = ~reported & (view_s >= RANKED_S - TIME_TOLERANCE_S)
    return PlainViewPart(
        counted=by_vehicle(counted),
        followed=by_vehicle(counted[followed[counted]]),
        counted_s=seconds(counted),
        view_s=view_s,
        first_s=seconds(near[near < first_report[truth.vehicle[near]]]),
        reported=reported,
        drops=by_vehicle(spans.first[dropped]),
        stopped=len(stopped),
        stopped_followed=int(followed[stopped].sum()),
        losses=_worst_first(_losses(evidence, near, spans, dropped, never)),
    )


def _spans(near: IntArray, truth: TruthRows, followed: BoolArray, is_near: BoolArray, step_s: FloatArray) -> _Spans:
    fresh = begins(is_near, truth.vehicle, truth.step)[near]
    changes = fresh.copy()
    changes[1:] |= followed[near][1:] != followed[near][:-1]
    of_row = np.cumsum(changes) - 1
    first = near[changes]
    lasts = np.bincount(of_row, step_s[near], minlength=len(first)).astype(np.float64)
    return _Spans(of_row, first, followed[first], fresh[changes], lasts)


def stopped_amid_traffic(truth: TruthRows, away_m: FloatArray) -> BoolArray:
    """Return which vehicles stand, and have stood for a while, where others near the ego drive, shape (n,).

    The others are all vehicles but the ego within ``PLAIN_VIEW_M`` of it, seen or not; without any, nobody counts.
    """
    speed = np.hypot(truth.speed_mps, truth.lat_speed_mps)
    standing_s = lasting_s(speed < STANDING_MPS, truth.vehicle, truth.step, truth.time_s)
    stands = standing_s >= STANDING_S - TIME_TOLERANCE_S
    around = away_m <= PLAIN_VIEW_M
    steps = int(truth.step.max(initial=-1)) + 1
    count = np.bincount(truth.step[around], minlength=steps)[truth.step] - around
    total = np.bincount(truth.step[around], speed[around], minlength=steps)[truth.step] - np.where(around, speed, 0.0)
    return np.asarray(stands & (total > FLOWING_MPS * count) & (count > 0))


def _losses(
    evidence: Evidence, near: IntArray, spans: _Spans, dropped: BoolArray, never: BoolArray
) -> list[dict[str, Any]]:
    """Return an entry for each vehicle never reported, and for each dropped the longest time without a track."""
    truth = evidence.rows.truth
    found = [(NEVER_REPORTED, near[truth.vehicle[near] == vehicle]) for vehicle in np.flatnonzero(never)]
    losing = np.flatnonzero(dropped)
    longest = losing[np.lexsort((-spans.lasts_s[losing], truth.vehicle[spans.first[losing]]))]
    vehicle = truth.vehicle[spans.first[longest]]
    one_each = longest[np.append(True, np.diff(vehicle) > 0)[: len(longest)]]
    found += [(DROPPED, near[spans.of_row == span]) for span in one_each]
    return [_entry(evidence, kind, rows) for kind, rows in found]


def _entry(evidence: Evidence, kind: str, rows: IntArray) -> dict[str, Any]:
    run, plain = evidence.rows, evidence.plain
    return {
        "id": str(plain.names[run.truth.vehicle[rows[0]]]),
        "kind": kind,
        "episode": int(run.episode[run.truth.step[rows[0]]]),
        "from_s": float(run.truth.time_s[rows[0]]),
        "to_s": float(run.truth.time_s[rows[-1]]),
        "closest_m": float(plain.away_m[rows].min()),
        "without_track_s": float(plain.step_s[rows].sum()),
        "detected_percent": 100.0 * float(run.truth.detected[rows].mean()),
    }


def _worst_first(losses: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    return sorted(losses, key=lambda loss: (-round(loss["without_track_s"], 6), loss["from_s"], loss["id"]))[
        :MOST_LISTED
    ]


def worst_share(counted: IntArray, followed: IntArray, chosen: BoolArray, share: float) -> IntArray:
    """Return the vehicles with the least recall, worst first: a share of the chosen, rounded down, but one at least.

    Of vehicles with equal recall the one with more vehicle-steps is worse, then the one that comes first.

    Args:
        counted: Vehicle-steps asked for of each vehicle, shape (vehicles,).
        followed: Those of them with a track.
        chosen: Vehicles with enough of them, shape (vehicles,).
        share: The share.
    """
    vehicles = np.flatnonzero(chosen)
    recall = followed[vehicles] / counted[vehicles]
    order = np.lexsort((-counted[vehicles], recall))
    return vehicles[order[: max(1, int(share * len(vehicles) + 1e-9))]]


@of_whole
def scores_in_plain_view(part: PlainViewPart) -> dict[str, object]:
    """Score who has a track in plain view.

    Asked for are the ``n`` vehicle-steps within 60 m of the ego (centre to centre) of vehicles that have been in plain
    view, so seen to the sensor's full-view fraction or more, for 0.5 s without interruption; detections play no part.

    Returns:
        ``recall``: percent of them with a reported track within the gate, each track serving one vehicle at most.
        ``worst_tenth``: the same over the ``worst_n`` vehicle-steps of the tenth of vehicles with the least recall of
        their own, among those with at least 1 s of such steps; the tenth is rounded down, but is one vehicle at least,
        and of equal vehicles the one with more steps counts as worse. ``median_first_report_s`` and
        ``p90_first_report_s`` over the ``vehicles_n`` vehicles asked for: time in plain view within 60 m, from its
        beginning to the first step there with a track. A vehicle that is never reported there counts with all of its
        time in plain view: the time is censored, so the truth is longer. ``never_reported``: vehicles that were in
        plain view within 60 m for 1 s or more in all and had a track at no step of it. ``dropped``: how often a
        vehicle's track ended, turned tentative or left the gate and the vehicle stayed in plain view within 60 m for
        0.5 s or more without one. ``stopped_recall``: the recall over the ``stopped_n`` vehicle-steps of vehicles that
        have been slower than 0.5 m/s for 2 s while the others within 60 m do more than 5 m/s on average.
        ``vehicles[]``: the vehicles never reported or dropped, the longest time without a track first, at most 20; of a
        dropped one its longest time. nan where there is nothing to tell.
    """
    counted, followed = part.counted, part.followed
    lasting = part.counted_s >= RANKED_S - TIME_TOLERANCE_S
    worst = worst_share(counted, followed, lasting, WORST_SHARE)
    waits = part.first_s[counted > 0]
    return {
        "recall": 100.0 * ratio(followed.sum(), counted.sum()),
        "n": int(counted.sum()),
        "worst_tenth": 100.0 * ratio(followed[worst].sum(), counted[worst].sum()),
        "worst_n": int(counted[worst].sum()),
        "median_first_report_s": of_any(np.median, waits),
        "p90_first_report_s": of_any(lambda them: np.percentile(them, 90), waits),
        "vehicles_n": len(waits),
        "never_reported": int((~part.reported & (part.view_s >= RANKED_S - TIME_TOLERANCE_S)).sum()),
        "dropped": int(part.drops.sum()),
        "stopped_recall": 100.0 * ratio(part.stopped_followed, part.stopped),
        "stopped_n": part.stopped,
        "vehicles": _worst_first(part.losses),
    }
