"""Scores by manoeuvre: straight on, turning left or right, oncoming, or on a roundabout.

Only where positions are in the plane, and of roundabouts where the network tells of one; on a road with a frame of its
own every vehicle goes straight on, and the table is left out.
"""

from dataclasses import dataclass

import numpy as np

from harness.scoring.evidence.errors import scored_rows
from harness.scoring.evidence.history import first_of_group
from harness.scoring.evidence.rows import RunRows, TruthRows
from harness.scoring.evidence.rules import TIME_TOLERANCE_S
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.hidden_outcomes import count_outcomes, hidden_outcomes
from harness.scoring.metrics.parts import of_whole, ratio
from harness.scoring.metrics.quantity import Quantity, of_kinds
from harness.storage.schema import HIDDEN
from mmpf.numerics.arrays import FloatArray, IntArray, wrapped

MANOEUVRES = ("straight", "left", "right", "oncoming", "roundabout")
STRAIGHT, LEFT, RIGHT, ONCOMING, ROUNDABOUT = range(5)
NAME = "manoeuvre"

TURN_RATE_RADPS = 0.2
"""Mean rate of the heading from which a vehicle turns: above that on a bend of 100 m radius and in a lane change."""
HALF_WINDOW_S = 1.0
"""The rate is taken over this long before and after; a change of lanes turns there and back in that time."""
SHORTEST_WINDOW_S = 1.0
ONCOMING_RAD = 0.75 * np.pi
"""Angle between a vehicle's heading and the ego's from which it comes towards the ego."""


QUANTITIES = of_kinds(
    NAME, {name: f", {name}" for name in MANOEUVRES},
    Quantity("position_m", "position error in sight{}, m", decimals=2, weight="n"),
    Quantity("speed_mps", "speed MAE in sight{}, m/s", decimals=2, weight="n"),
    Quantity("hidden_tracked_percent", "hidden tracked{}, %", True, weight="hidden_n"),
    Quantity("same_id_percent", "same identity after occlusion{}, %", True, weight="events"),
)  # fmt: skip


@dataclass(frozen=True)
class ManoeuvrePart:
    """Counts of each of ``MANOEUVRES``, shape (5,), outcomes of hidden vehicle-steps of shape (5, outcomes).

    ``error_sum`` adds up the followed ones' absolute errors of position and speed, shape (2, 5); ``same_id`` counts the
    events after which a vehicle has its old track.
    """

    has_roundabouts: bool
    followed: IntArray
    in_sight: IntArray
    error_sum: FloatArray
    outcomes: IntArray
    events: IntArray
    same_id: IntArray


def manoeuvres(rows: RunRows) -> IntArray | None:
    """Return what each vehicle does at each step, an index into ``MANOEUVRES``, shape (n,) along ``TruthRows``.

    None on a road with a frame of its own, along which everybody goes straight on.

    A vehicle turns where its heading changes by more than ``TURN_RATE_RADPS`` on average over the second before and the
    second after; one that does not is oncoming if it heads against the ego, and goes straight on otherwise, be it along
    or across the ego's way. Whoever is on a roundabout does that, whichever way it turns.
    """
    if not rows.has_headings:
        return None
    truth = rows.truth
    rate = heading_rate(truth)
    code = np.where(rate > 0.0, LEFT, RIGHT)
    code[np.abs(rate) <= TURN_RATE_RADPS] = STRAIGHT
    away = wrapped(truth.direction_rad - rows.ego_direction_rad[truth.step])
    code[(code == STRAIGHT) & (np.abs(away) > ONCOMING_RAD)] = ONCOMING
    if rows.on_roundabout is not None:
        code[rows.on_roundabout] = ROUNDABOUT
    return code


def heading_rate(truth: TruthRows) -> FloatArray:
    """Return the mean rate of each vehicle's direction within a second to either side, rad/s, shape (n,).

    It is 0 where the record around a step is shorter than a second.
    """
    if not len(truth):
        return np.zeros(0)
    first = first_of_group(truth.vehicle)
    # Directions wind up, so that a difference over several steps is the angle turned.
    turned = np.cumsum(np.where(first, 0.0, wrapped(np.diff(truth.direction_rad, prepend=0.0))))
    period_s = float(truth.time_s.max() - truth.time_s.min()) + 4.0 * HALF_WINDOW_S
    clock = truth.vehicle * period_s + truth.time_s
    low = np.searchsorted(clock, clock - HALF_WINDOW_S - TIME_TOLERANCE_S)
    high = np.searchsorted(clock, clock + HALF_WINDOW_S + TIME_TOLERANCE_S, side="right") - 1
    took_s = truth.time_s[high] - truth.time_s[low]
    long_enough = took_s >= SHORTEST_WINDOW_S - TIME_TOLERANCE_S
    rate = np.divide(turned[high] - turned[low], took_s, out=np.zeros(len(truth)), where=long_enough)
    return np.asarray(rate)


def measure_manoeuvres(evidence: Evidence) -> ManoeuvrePart | None:
    """Count in a stretch; None on a road with a frame of its own."""
    rows, errors = evidence.rows, evidence.errors
    code = manoeuvres(rows)
    if code is None:
        return None
    kept = scored_rows(rows, evidence.history)
    of_kept, hidden = code[kept], errors.state == HIDDEN
    followed = errors.tracked & ~hidden
    position_m = np.hypot(errors.absolute[:, 0], errors.absolute[:, 1])
    values = np.stack([position_m, errors.absolute[:, 2]])[:, followed]
    of_event = manoeuvre_between(code, evidence.events.onset_row, evidence.events.return_row)

    def count(codes: IntArray) -> IntArray:
        return np.bincount(codes, minlength=len(MANOEUVRES))

    return ManoeuvrePart(
        has_roundabouts=rows.on_roundabout is not None,
        followed=count(of_kept[followed]),
        in_sight=count(of_kept[~hidden]),
        error_sum=np.stack([np.bincount(of_kept[followed], row, minlength=len(MANOEUVRES)) for row in values]),
        outcomes=np.stack([count_outcomes(errors.outcome[hidden & (of_kept == k)]) for k in range(len(MANOEUVRES))]),
        events=count(of_event),
        same_id=count(of_event[evidence.events.same_id]),
    )


@of_whole
def scores_by_manoeuvre(part: ManoeuvrePart) -> dict[str, object]:
    """Return the scores of vehicles that go straight on, turn or come towards the ego.

    Returns:
        For each of ``MANOEUVRES``: mean absolute errors ``position_m`` and ``speed_mps`` of vehicles that are not
        hidden over the ``n`` vehicle-steps followed of ``of_n``; shares ``hidden_tracked_percent``,
        ``hidden_lost_percent``, ``hidden_hijacked_percent`` and ``hidden_untracked_percent`` of ``hidden_n``
        vehicle-steps hidden; and ``same_id_percent`` of ``events`` occlusions, each of the manoeuvre of its return, or
        of the turn in it, or of the roundabout. Empty on a road with a frame of its own; without ``roundabout`` where
        none is known.
    """
    table: dict[str, object] = {}
    told = MANOEUVRES if part.has_roundabouts else MANOEUVRES[:ROUNDABOUT]
    for code, name in enumerate(told):
        hidden = {f"hidden_{key}": value for key, value in hidden_outcomes(part.outcomes[code]).items()}
        table[name] = {
            "position_m": ratio(part.error_sum[0, code], part.followed[code]),
            "speed_mps": ratio(part.error_sum[1, code], part.followed[code]),
            "n": int(part.followed[code]),
            "of_n": int(part.in_sight[code]),
            **hidden,
            "same_id_percent": 100.0 * ratio(part.same_id[code], part.events[code]),
            "events": int(part.events[code]),
        }
    return table


def manoeuvre_between(code: IntArray, onset: IntArray, back: IntArray) -> IntArray:
    """Return the manoeuvre of each time from one row to another: a turn or roundabout in it, or that at its end."""
    manoeuvre = code[back]
    for turn in (LEFT, RIGHT, ROUNDABOUT):
        before = np.concatenate([[0], np.cumsum(code == turn)])
        manoeuvre = np.where(before[back + 1] > before[onset], turn, manoeuvre)
    return np.asarray(manoeuvre, dtype=np.int64)
