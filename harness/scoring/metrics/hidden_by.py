"""Scores of hidden vehicles by what hid them: other vehicles, or walls of buildings.

A vehicle behind a building stays hidden for longer, and where it comes back follows from the map; one behind a lorry
comes back as the lorry moves. Only on roads with walls; elsewhere vehicles hide everything, and the table is left out.
"""

from dataclasses import dataclass

import numpy as np

from harness.scoring.evidence.errors import scored_rows
from harness.scoring.evidence.events import other_track_after
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.hidden_outcomes import count_outcomes, hidden_outcomes
from harness.scoring.metrics.parts import of_whole, ratio
from harness.scoring.metrics.quantity import Quantity, of_kinds
from harness.storage.schema import HIDDEN
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

NAME = "hidden_by"
CAUSES = ("vehicle", "building")


QUANTITIES = of_kinds(
    NAME, {name: f", behind a {name}" for name in CAUSES},
    Quantity("hidden_cost_m", "hidden cost{}, m", decimals=2, weight="n", limit=FOLLOW_CUTOFF_M),
    Quantity("hidden_tracked_percent", "hidden tracked{}, %", True, weight="hidden_n"),
    Quantity("same_id_percent", "same identity after occlusion{}, %", True, weight="events"),
    Quantity("switch_percent", "identity switched in occlusion{}, %", weight="events"),
)  # fmt: skip


@dataclass(frozen=True)
class CausePart:
    """Counts of each of ``CAUSES``, shape (2,), outcomes of shape (2, outcomes).

    ``n`` vehicle-steps hidden of vehicles once seen have distances that add up to ``cost_m``; of the ``events`` some
    end with the old track (``same_id``) and some with another one (``switched``).
    """

    n: IntArray
    cost_m: FloatArray
    outcomes: IntArray
    events: IntArray
    same_id: IntArray
    switched: IntArray


def measure_causes(evidence: Evidence) -> CausePart | None:
    """Count in a stretch; None on a road without walls."""
    rows, errors, events = evidence.rows, evidence.errors, evidence.events
    by_wall = rows.hidden_by_wall
    if by_wall is None:
        return None
    cause = by_wall.astype(np.int64)
    hidden = evidence.following.hidden
    distance_m = evidence.following.distance_m[hidden]
    of_errors, unseen = cause[scored_rows(rows, evidence.history)], errors.state == HIDDEN
    of_event = cause_between(cause == 1, rows.truth.state == HIDDEN, events.onset_row, events.return_row)

    def count(codes: IntArray) -> IntArray:
        return np.bincount(codes, minlength=len(CAUSES))

    return CausePart(
        n=count(cause[hidden]),
        cost_m=np.asarray(np.bincount(cause[hidden], distance_m, minlength=len(CAUSES)), dtype=np.float64),
        outcomes=np.stack([count_outcomes(errors.outcome[unseen & (of_errors == k)]) for k in range(len(CAUSES))]),
        events=count(of_event),
        same_id=count(of_event[events.same_id]),
        switched=count(of_event[other_track_after(rows, evidence.matching, events)]),
    )


def cause_between(by_wall: BoolArray, hidden: BoolArray, onset: IntArray, back: IntArray) -> IntArray:
    """Return what hid a vehicle for most of its hidden steps from one row to a later one, an index into ``CAUSES``.

    Args:
        by_wall: Whether walls hide more of the vehicle than others do, shape (n,) along the truth rows.
        hidden: Whether it is hidden, shape (n,).
        onset: First row of each time, shape (e,).
        back: Last row of each, shape (e,).
    """
    walls, all_hidden = (np.append(0, np.cumsum(each)) for each in (by_wall & hidden, hidden))
    of_walls, of_all = (each[back + 1] - each[onset] for each in (walls, all_hidden))
    return np.asarray(2 * of_walls > of_all, dtype=np.int64)


@of_whole
def scores_by_cause(part: CausePart) -> dict[str, object]:
    """Return the scores of hidden vehicles by what hid them.

    Returns:
        For each of ``CAUSES``: ``hidden_cost_m`` over the ``n`` vehicle-steps hidden of vehicles once seen, as that of
        ``hidden``; shares ``hidden_tracked_percent``, ``hidden_lost_percent``, ``hidden_hijacked_percent`` and
        ``hidden_untracked_percent`` of ``hidden_n`` vehicle-steps, as those of ``hidden_outcomes``; and of ``events``
        occlusions, each of what hid the vehicle for most of it, ``same_id_percent``, after which it has its old track,
        and ``switches``, after which it has another one, with their share ``switch_percent``. Empty where there are no
        walls.
    """
    return {
        name: {
            "hidden_cost_m": ratio(part.cost_m[code], part.n[code]),
            "n": int(part.n[code]),
            **{f"hidden_{key}": value for key, value in hidden_outcomes(part.outcomes[code]).items()},
            "same_id_percent": 100.0 * ratio(part.same_id[code], part.events[code]),
            "switch_percent": 100.0 * ratio(part.switched[code], part.events[code]),
            "switches": int(part.switched[code]),
            "events": int(part.events[code]),
        }
        for code, name in enumerate(CAUSES)
    }
