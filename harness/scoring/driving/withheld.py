"""Vehicles ahead of the ego in plain view that the tracker does not report.

A driver who sees no track does not slow down, however gently the ego did when the run was recorded. So the truth's
demand alone, made at the ego's recorded speed, does not tell what is missed: an ego that rolls gently up to a stopped
car never has to brake hard, and by the tracks it would have driven into it.
"""

from dataclasses import dataclass

import numpy as np

from harness.decisions.decide import most_decisive
from harness.scoring.driving.asked import Asked
from harness.scoring.driving.collision_time import time_to_collision
from harness.scoring.evidence.matching import Matching
from harness.scoring.evidence.plain_view import PlainView
from harness.scoring.evidence.rows import RunRows
from harness.scoring.evidence.rules import BRAKES_MPS2, COLLISION_TIME_S, ROLLS_MPS2
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class WithheldAhead:
    """Whether the tracker withholds the ego's leader at each step, shape (steps,).

    ``decisive`` is the vehicle without which the driver would brake least, ``leader`` that right ahead, to which
    ``collision_s`` is the time, infinite where the gap does not close.
    """

    decisive: BoolArray
    leader: BoolArray
    collision_s: FloatArray

    def misses(self, needed: FloatArray, done: FloatArray) -> BoolArray:
        """Return where the driver ought to brake for a withheld vehicle and by the tracks does not, shape (steps,).

        It ought to where by the truth it brakes (``needed``), and the tracks then have it brake less (``done``) by the
        difference of braking and not braking at all (1 m/s²) or more; and where the time to collision is short, and it
        does not brake.
        """
        least = ROLLS_MPS2 - BRAKES_MPS2
        brakes_less = (needed <= BRAKES_MPS2) & (done > needed + least)
        drives_on = (self.collision_s < COLLISION_TIME_S) & (done > ROLLS_MPS2)
        return np.asarray((self.decisive & brakes_less) | (self.leader & drives_on))


def find_withheld(asked: Asked, rows: RunRows, matching: Matching, plain: PlainView) -> WithheldAhead:
    """Find the steps at which the vehicle that matters is withheld.

    Withheld is whoever has been in plain view for ``PLAIN_VIEW_S`` at any distance and has no track within the gate
    that the driver believes: one that is reported, with an existence of one half or more. Detections play no part.
    """
    believed = np.zeros(len(rows.tracks) + 1, dtype=bool)
    believed[asked.track_row] = True
    withheld = np.append(plain.lasting & ~believed[matching.track_row], False)
    ahead: IntArray = asked.truth.belief.leader.body
    leader = asked.truth.belief.leader
    return WithheldAhead(
        decisive=withheld[most_decisive(asked.driver, asked.truth.belief)],
        leader=withheld[ahead],
        collision_s=time_to_collision(leader.gap_m, asked.truth.belief.speed_mps, leader.speed_mps),
    )
