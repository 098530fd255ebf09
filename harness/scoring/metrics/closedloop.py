"""Scores of a closed-loop drive: collisions, conflicts, comfort, and missed and phantom brakings.

The rows are a closed loop's (``harness.closedloop``): the ego really did what its driver demanded, and the others
reacted. Everything is measured by the truth.
"""

from dataclasses import dataclass

import numpy as np

from harness.scoring.driving.collision_time import time_to_collision
from harness.scoring.driving.withheld import WithheldAhead
from harness.scoring.evidence.rules import BRAKES_MPS2, ROLLS_MPS2
from harness.scoring.evidence.stretches import lasting_stretches, missed_stretches, stretches
from harness.scoring.metrics.conflicts import HARD_DRAC_MPS2, SHORT_TTC_S, deceleration_to_avoid
from harness.scoring.metrics.quantity import Quantity
from mmpf.numerics.arrays import BoolArray, FloatArray

HARD_BRAKE_MPS2 = -3.0
TABLE = "drive"
COLLIDED, TTC = f"{TABLE}.collided_percent", f"{TABLE}.ttc_below_1_5_percent"
DRAC, HARD_BRAKES = f"{TABLE}.drac_above_3_4_percent", f"{TABLE}.hard_brakes_per_km"
IMPACT, ENDED, WITH = f"{TABLE}.impact_mps", f"{TABLE}.ended", f"{TABLE}.collided_with"
KM = f"{TABLE}.km"
IN_TIME, BY_COLLISION, OFF_THE_ROAD, NO_CANDIDATE = "in time", "collision", "left the road", "no candidate"
WAY_ENDED = "came to where its way ends"

QUANTITIES = (
    Quantity(COLLIDED, "episodes with a collision, %"),
    Quantity(IMPACT, "impact speed, m/s"),
    Quantity(TTC, "time with TTC below 1.5 s, %", decimals=2),
    Quantity(DRAC, "time with DRAC above 3.4 m/s², %", decimals=2),
    Quantity(HARD_BRAKES, "hard brakes (below -3 m/s²) a km", decimals=2, weight=KM, is_counted=True),
    Quantity(f"{TABLE}.missed_per_km", "missed brakings a km", decimals=2, weight=KM, is_counted=True),
    Quantity(f"{TABLE}.phantom_per_km", "phantom brakings a km", decimals=2, weight=KM, is_counted=True),
    Quantity(f"{TABLE}.mean_speed_mps", "mean speed, m/s", higher_is_better=True, decimals=2),
    Quantity(f"{TABLE}.jerk_mps3", "jerk, root mean square, m/s³", decimals=2),
    Quantity(f"{TABLE}.crossed_percent", "episodes in which the ego got across, %", higher_is_better=True),
    Quantity(
        f"{TABLE}.yielded_percent", "episodes in which the ego let the provoked vehicle pass first, %",
        higher_is_better=True,
    ),
    Quantity(f"{TABLE}.waited_s", "time of waiting before the crossing, s"),
    Quantity(f"{TABLE}.pet_below_1_5_percent", "episodes with a post-encroachment time below 1.5 s, %"),
    Quantity(
        f"{TABLE}.made_brake_percent", "episodes in which one with right of way brakes hard while the ego crosses, %",
    ),
    Quantity(f"{TABLE}.unsafe_to_go_percent", "moments of holding with the truth at which the ego goes, %"),
)  # fmt: skip
"""The last six are of episodes alone in which the ego comes to where it must yield."""
SHORT_PET_S = 1.5
PRIMARY = (COLLIDED, TTC, HARD_BRAKES)
"""What ``compare`` judges of a closed loop unless asked otherwise."""


@dataclass(frozen=True)
class DriveRecord:
    """What the ego did by its belief, and what it had before it; by the truth, at each of n steps, shape (n,).

    Attributes:
        gap_m: Clear distance to whoever is right ahead, infinite for nobody.
        leader_mps: Speed of that vehicle, 0 for nobody.
        demanded_mps2: Acceleration that the driver demands by the belief.
        needed_mps2: What it would demand by the truth.
        step_s: Time between steps.
        withheld: Whether that vehicle right ahead is in plain view and the tracker withholds it; None for never.
    """

    speed_mps: FloatArray
    gap_m: FloatArray
    leader_mps: FloatArray
    demanded_mps2: FloatArray
    needed_mps2: FloatArray
    step_s: float
    withheld: BoolArray | None = None


@dataclass(frozen=True)
class Contact:
    """The first moment at which the ego's body and another's overlap, ``time_s`` since the hand-over.

    ``impact_mps`` is the difference of their speeds along the road, not negative; ``into`` says whether the ego ran
    into the other, else it was run into.
    """

    vehicle_id: str
    time_s: float
    impact_mps: float
    into: bool


@dataclass(frozen=True)
class Crossed:
    """The outcome of the first place on the ego's route where it must yield.

    Attributes:
        entered_s: When its front came to the place, since the hand-over; None for never.
        left_s: When its rear left it.
        waited_s: How long it was slower than 1 m/s before it.
        holds: Whether it held by what it believed, at each step until it was there, shape (n,).
        must_hold: Whether it would have by the truth, shape (n,).
        encroachment_s: Least post-encroachment time with those who had right of way; None where it met none of them.
        yielded: Whether the ego let the provoked vehicle pass, or waited until the end; None where their paths do not
            cross.
        made_brake: Whether one who had right of way braked hard while the ego was at the place.
    """

    entered_s: float | None
    left_s: float | None
    waited_s: float
    holds: BoolArray
    must_hold: BoolArray
    encroachment_s: float | None
    yielded: bool | None
    made_brake: bool


def score_crossing(crossed: Crossed) -> dict[str, object]:
    """Return what a crossing adds to the table ``drive``; what there is none of is None."""
    must, time_s = crossed.must_hold, crossed.encroachment_s
    return {
        "crossed_percent": 0.0 if crossed.left_s is None else 100.0,
        "enters_s": crossed.entered_s,
        "waited_s": crossed.waited_s,
        "yielded_percent": None if crossed.yielded is None else 100.0 * crossed.yielded,
        "pet_s": time_s,
        "pet_below_1_5_percent": 100.0 * (time_s is not None and time_s < SHORT_PET_S),
        "made_brake_percent": 100.0 * crossed.made_brake,
        "must_hold": int(must.sum()),
        "unsafe_to_go_percent": 100.0 * float((~crossed.holds[must]).mean()) if must.any() else None,
    }


def score_drive(driven: DriveRecord, ended: str, contact: Contact | None) -> dict[str, object]:
    """Score an episode's drive.

    Args:
        driven: The steps from the hand-over on, at least two.
        ended: Why it ended: one of the words of this module.
        contact: Its collision; None for none.

    Returns:
        The table ``drive`` of its row. Shares are of the time that it drove; what there is none of is None.
    """
    step_s = driven.step_s
    accel = np.diff(driven.speed_mps) / step_s
    jerk = np.diff(accel) / step_s
    drives_s = step_s * len(accel)
    km = float(0.5 * (driven.speed_mps[1:] + driven.speed_mps[:-1]).sum()) * step_s / 1e3
    ttc = time_to_collision(driven.gap_m, driven.speed_mps, driven.leader_mps)
    drac = deceleration_to_avoid(driven.gap_m, driven.speed_mps, driven.leader_mps)
    no_episodes, each_s = np.zeros(len(ttc), dtype=np.int64), np.full(len(ttc), step_s)
    hard = len(stretches(accel < HARD_BRAKE_MPS2, no_episodes[1:])[0])
    needed, demanded = driven.needed_mps2, driven.demanded_mps2
    fails = (needed <= BRAKES_MPS2) & (demanded > ROLLS_MPS2)
    makes_up = (demanded <= BRAKES_MPS2) & (needed > ROLLS_MPS2)
    phantom = len(lasting_stretches(makes_up, no_episodes, each_s)[0])
    withheld = np.zeros(len(needed), dtype=bool) if driven.withheld is None else driven.withheld
    unbraked = WithheldAhead(withheld, withheld, ttc).misses(needed, demanded)
    begins, ends = missed_stretches(fails, unbraked, no_episodes, each_s)
    missed = len(begins)
    of_withheld = sum(bool(unbraked[a : b + 1].any()) for a, b in zip(begins, ends, strict=True))
    return {
        "ended": ended,
        "drives_s": round(drives_s, 6),
        "km": km,
        "collided_percent": 0.0 if contact is None else 100.0,
        "collided_with": None if contact is None else contact.vehicle_id,
        "ran_into": None if contact is None else float(contact.into),
        "collision_time_s": None if contact is None else contact.time_s,
        "impact_mps": None if contact is None else contact.impact_mps,
        "ttc_below_1_5_percent": 100.0 * float((ttc < SHORT_TTC_S[0]).mean()),
        "drac_above_3_4_percent": 100.0 * float((drac > HARD_DRAC_MPS2).mean()),
        "hard_brakes": hard,
        "hard_brakes_per_km": _per(hard, km),
        "missed": missed,
        "missed_withheld": of_withheld,
        "missed_per_km": _per(missed, km),
        "phantom": phantom,
        "phantom_per_km": _per(phantom, km),
        "mean_speed_mps": 1e3 * km / drives_s,
        "jerk_mps3": float(np.sqrt((jerk**2).mean())) if len(jerk) else None,
    }


def _per(count: int, km: float) -> float | None:
    return count / km if km > 0.0 else None
