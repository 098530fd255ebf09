"""Surrogate safety measures of the traffic itself (TTC, DRAC and PET), from the truth alone.

They tell how tense the traffic around the ego is, not how good a tracker is: every tracker of the same traffic has the
same ones.
"""

from dataclasses import dataclass, field

import numpy as np

from harness.scoring.driving.collision_time import time_to_collision
from harness.scoring.driving.encroachment import post_encroachment_times
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import ROWS, of_any, of_whole
from mmpf.numerics.arrays import FloatArray

SHORT_TTC_S, HARD_DRAC_MPS2 = (1.5, 3.0), 3.4
"""Limits of a conflict in the literature."""


def deceleration_to_avoid(gap_m: FloatArray, speed_mps: FloatArray, leader_mps: FloatArray) -> FloatArray:
    """Return the steady braking that just avoids a collision, DRAC (Cooper and Ferguson 1976); 0 where none must, (n,).

    Infinite where the two touch already.
    """
    closing = speed_mps - leader_mps
    needed = np.isfinite(gap_m) & (closing > 0.0)
    with np.errstate(divide="ignore"):
        braking = np.divide(0.5 * closing**2, np.maximum(gap_m, 0.0), out=np.zeros(len(gap_m)), where=needed)
    return np.asarray(braking)


@dataclass(frozen=True)
class ConflictPart:
    """Time to collision with whoever is ahead, infinite for none, DRAC, 0 for none, at each step; encounters' PET."""

    ttc_s: FloatArray = field(metadata=ROWS)
    drac_mps2: FloatArray = field(metadata=ROWS)
    pet_s: FloatArray = field(metadata=ROWS)


def measure_conflicts(evidence: Evidence) -> ConflictPart | None:
    """Measure a stretch; None where no driver was asked, since only then is it known who is ahead of the ego."""
    asked = evidence.asked
    if asked is None:
        return None
    belief, leader = asked.truth.belief, asked.truth.belief.leader
    there = asked.there
    return ConflictPart(
        ttc_s=time_to_collision(leader.gap_m, belief.speed_mps, leader.speed_mps)[there],
        drac_mps2=deceleration_to_avoid(leader.gap_m, belief.speed_mps, leader.speed_mps)[there],
        pet_s=post_encroachment_times(asked.egos, asked.bodies, evidence.rows),
    )


@of_whole
def conflicts(part: ConflictPart) -> dict[str, object]:
    """Score the ego's conflicts.

    Returns:
        Over ``n`` steps: ``ttc_below_1_5_percent`` and ``ttc_below_3_percent`` of them, ``ttc_min_s``;
        ``drac_above_3_4_percent``, ``drac_max_mps2`` and ``drac_p95_mps2`` (over the ``closing_n`` steps at which the
        ego closes in); ``pet_n`` encounters, ``pet_min_s`` and ``pet_median_s``. nan where there is nothing to tell;
        empty where nobody was asked.
    """
    ttc, drac, pet = part.ttc_s, part.drac_mps2, part.pet_s
    finite, closing = ttc[np.isfinite(ttc)], drac[np.isfinite(drac) & (drac > 0.0)]
    return {
        "n": len(ttc),
        "ttc_below_1_5_percent": 100.0 * of_any(np.mean, ttc < SHORT_TTC_S[0]),
        "ttc_below_3_percent": 100.0 * of_any(np.mean, ttc < SHORT_TTC_S[1]),
        "ttc_min_s": of_any(np.min, finite),
        "drac_above_3_4_percent": 100.0 * of_any(np.mean, drac > HARD_DRAC_MPS2),
        "drac_p95_mps2": of_any(lambda them: np.percentile(them, 95), closing),
        "drac_max_mps2": of_any(np.max, closing),
        "closing_n": len(closing),
        "pet_n": len(pet),
        "pet_min_s": of_any(np.min, pet),
        "pet_median_s": of_any(np.median, pet),
    }
