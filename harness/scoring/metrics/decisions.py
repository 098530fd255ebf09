"""Differences between the driver's decisions by the tracks and by the truth.

The ego drives as it did; nothing that the driver would do is done. So every tracker is asked of the same traffic.
"""

from dataclasses import dataclass, field

import numpy as np

from harness.scoring.driving.asked import Asked
from harness.scoring.driving.brakings import MISSED, MISSED_FATES, PHANTOM, PHANTOM_FATES
from harness.scoring.driving.collision_time import time_to_collision
from harness.scoring.evidence.rules import BRAKES_MPS2, COLLISION_TIME_S, DECISION_S, TIME_TOLERANCE_S
from harness.scoring.evidence.stretches import stretches
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import ROWS, of_any, of_whole, ratio
from harness.scoring.metrics.quantity import Quantity
from harness.storage.schema import BRAKING_KINDS, FATES, HIDDEN, OUT
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

LONGEST_COLLISION_TIME_S = 10.0
"""Longest time to collision that is told apart from none."""
KM = "decisions.km"
MISSED_PER_KM, PHANTOM_PER_KM = "decisions.missed_per_km", "decisions.phantom_per_km"
QUANTITIES = (
    *(
        Quantity(key, name, decimals=2, heading=name, weight=KM, is_counted=True)
        for key, name in ((MISSED_PER_KM, "missed brakings a km"), (PHANTOM_PER_KM, "phantom brakings a km"))
    ),
    Quantity(
        "decisions.accel_difference_mps2", "difference of demanded acceleration, m/s²",
        decimals=3, heading="demand m/s²", weight="decisions.n",
    ),
    Quantity(
        "decisions.lateness_s", "lateness of braking, s",
        decimals=2, heading="lateness s", weight="decisions.onsets",
    ),
    Quantity(
        "decisions.collision_time_error_s", "error of time to collision below 4 s, s",
        decimals=2, heading="TTC error s", weight="decisions.collision_time_n",
    ),
    Quantity(
        "decisions.unsafe_gaps_percent", "unsafe gaps accepted, %",
        heading="unsafe gaps %", weight="decisions.forbidden_gaps",
    ),
)  # fmt: skip


@dataclass(frozen=True)
class DecisionPart:
    """What the driver would have done in a stretch.

    Attributes:
        difference_mps2: By the tracks less by the truth at each judged step, shape (n,).
        km: Distance that the ego drove at them.
        kind: Of each missed or phantom braking, see ``Brakings``, as ``fate`` and ``withheld``.
        hidden: Whether the vehicle to blame was hidden or never in the sensor's range, of each.
        lateness_s: Of each onset of braking.
        collision_time_error_s: Of each step with a short time to collision.
        forbidden: Gaps beside the ego that the truth forbids, over steps and sides.
        accepted: Those of them that the tracks accept.
    """

    km: float
    forbidden: int
    accepted: int
    difference_mps2: FloatArray = field(metadata=ROWS)
    kind: IntArray = field(metadata=ROWS)
    fate: IntArray = field(metadata=ROWS)
    hidden: BoolArray = field(metadata=ROWS)
    withheld: BoolArray = field(metadata=ROWS)
    lateness_s: FloatArray = field(metadata=ROWS)
    collision_time_error_s: FloatArray = field(metadata=ROWS)


def measure_decisions(evidence: Evidence) -> DecisionPart | None:
    """Measure a stretch; None where no driver was asked."""
    asked, brakings = evidence.asked, evidence.brakings
    if asked is None or brakings is None:
        return None
    state = np.append(evidence.rows.truth.state, -1)[brakings.truth_row]
    by_truth, by_tracks = asked.truth.command, asked.tracks.command
    forbidden, accepted = 0, 0
    for of_truth, of_tracks, lane in (
        (by_truth.accepts_left, by_tracks.accepts_left, asked.truth.belief.left.exists),
        (by_truth.accepts_right, by_tracks.accepts_right, asked.truth.belief.right.exists),
    ):
        asked_for = asked.judged & lane & ~of_truth
        forbidden += int(asked_for.sum())
        accepted += int((asked_for & of_tracks).sum())
    return DecisionPart(
        difference_mps2=(by_tracks.accel_mps2 - by_truth.accel_mps2)[asked.judged],
        km=float(asked.driven_m.sum()) / 1e3,
        kind=brakings.kind,
        fate=brakings.fate,
        hidden=np.isin(state, (HIDDEN, OUT)),
        withheld=brakings.withheld,
        lateness_s=lateness(asked, evidence.rows.episode),
        collision_time_error_s=collision_time_errors(asked),
        forbidden=forbidden,
        accepted=accepted,
    )


def lateness(asked: Asked, episode: IntArray) -> FloatArray:
    """Return how much later by the tracks than by the truth the driver begins to brake, of each onset, shape (k,).

    An onset is a stretch of half a second or more in which the truth demands braking. Where the tracks do so when it
    begins, the lateness is 0; where they never do, it is the whole stretch.
    """
    brakes = asked.truth.command.accel_mps2 <= BRAKES_MPS2
    late = []
    for first, last in zip(*stretches(brakes & asked.judged, episode), strict=True):
        seconds = asked.step_s[first : last + 1]
        begun_before = first > 0 and episode[first - 1] == episode[first] and not asked.judged[first - 1]
        if seconds.sum() < DECISION_S - TIME_TOLERANCE_S or begun_before:
            continue
        done = asked.tracks.command.accel_mps2[first : last + 1] <= BRAKES_MPS2
        late.append(float(seconds[: int(done.argmax()) if done.any() else len(seconds)].sum()))
    return np.array(late)


def collision_time_errors(asked: Asked) -> FloatArray:
    """Return absolute errors of the time to collision with the vehicle ahead, where it is short, shape (k,)."""
    true_s, believed_s = (
        np.minimum(time_to_collision(own.leader.gap_m, own.speed_mps, own.leader.speed_mps), LONGEST_COLLISION_TIME_S)
        for own in (asked.truth.belief, asked.tracks.belief)
    )
    return np.asarray(np.abs(believed_s - true_s)[asked.judged & (true_s < COLLISION_TIME_S)])


@of_whole
def decisions(part: DecisionPart) -> dict[str, object]:
    """Score what the driver would have done.

    Returns:
        ``km`` and ``n`` steps that are judged; ``accel_difference_mps2`` and ``accel_difference_p99_mps2``, mean and
        99th percentile of the absolute difference of demanded accelerations; ``missed`` and ``phantom`` brakings and
        either ``_per_km``; ``missed_hidden``, those for a hidden vehicle, and ``missed_withheld``, those for one in
        plain view that has no track which the driver believes; ``missed_by`` and ``phantom_by`` what the
        track did; ``lateness_s`` over ``onsets``; ``collision_time_error_s`` over ``collision_time_n`` steps;
        ``unsafe_gaps_percent`` of ``forbidden_gaps``. nan where there is nothing to tell; empty where nobody was asked.
    """
    difference = np.abs(part.difference_mps2)
    kind, km, forbidden = part.kind, part.km, part.forbidden
    table: dict[str, object] = {
        "km": km,
        "n": len(difference),
        "accel_difference_mps2": of_any(np.mean, difference),
        "accel_difference_p99_mps2": of_any(lambda them: np.percentile(them, 99), difference),
    }
    for code in (MISSED, PHANTOM):
        count = int((kind == code).sum())
        table |= {BRAKING_KINDS[code]: count, f"{BRAKING_KINDS[code]}_per_km": ratio(count, km)}
    table["missed_hidden"] = int(((kind == MISSED) & part.hidden).sum())
    table["missed_withheld"] = int(part.withheld.sum())
    for code, possible in ((MISSED, MISSED_FATES), (PHANTOM, PHANTOM_FATES)):
        of_kind = part.fate[kind == code]
        table[f"{BRAKING_KINDS[code]}_by"] = {FATES[place]: int((of_kind == place).sum()) for place in possible}
    return table | {
        "lateness_s": of_any(np.mean, part.lateness_s),
        "onsets": len(part.lateness_s),
        "collision_time_error_s": of_any(np.mean, part.collision_time_error_s),
        "collision_time_n": len(part.collision_time_error_s),
        "unsafe_gaps_percent": ratio(100.0 * part.accepted, forbidden),
        "forbidden_gaps": forbidden,
    }
