"""Lane changes by MOBIL (Kesting, Treiber and Helbing, TRR 1999 (2007))."""

from harness.decisions.belief import Belief, Beside, Others
from harness.decisions.drivers.following import follower_acceleration, following, safe_gap
from harness.decisions.drivers.protocol import Command
from mmpf.numerics.arrays import BoolArray, FloatArray

POLITENESS = 0.2
THRESHOLD_MPS2 = 0.1


class MobilDriver:
    """Follows as the intelligent driver model does; takes a safe gap that gains more than a share of others' losses."""

    def command(self, belief: Belief) -> Command:
        """Return what it would do; see ``Driver``."""
        accel = following(belief, belief.leader)
        return Command(accel, _takes(belief, belief.left, accel), _takes(belief, belief.right, accel))


def _takes(belief: Belief, side: Beside, accel_mps2: FloatArray) -> BoolArray:
    """Return whether it would change to that lane, by the symmetric criterion, shape (n,)."""
    gain = following(belief, side.leader) - accel_mps2
    new = _loss(belief, side.follower, _between(belief, side.leader, side.follower))
    old = _loss(belief, belief.follower, _between(belief, belief.leader, belief.follower))
    return safe_gap(belief, side) & (gain - POLITENESS * (new - old) > THRESHOLD_MPS2)


def _loss(belief: Belief, follower: Others, ahead: Others) -> FloatArray:
    """Return how far a follower's acceleration is from that behind ``ahead``, 0 where there is none, shape (n,)."""
    loss = follower_acceleration(belief, follower, ahead) - follower_acceleration(belief, follower, None)
    return loss * follower.exists


def _between(belief: Belief, leader: Others, follower: Others) -> Others:
    """Return a leader as its follower sees it while the ego is not between them."""
    return Others(leader.gap_m + belief.length_m + follower.gap_m, leader.speed_mps, leader.body)
