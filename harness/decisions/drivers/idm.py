"""The intelligent driver model: it reacts only to the vehicle directly ahead."""

from harness.decisions.belief import Belief
from harness.decisions.drivers.following import following, safe_gap
from harness.decisions.drivers.protocol import Command


class IdmDriver:
    """The intelligent driver model (Treiber, Hennecke and Helbing 2000)."""

    def command(self, belief: Belief) -> Command:
        """Return what it would do; see ``Driver``."""
        return Command(following(belief, belief.leader), safe_gap(belief, belief.left), safe_gap(belief, belief.right))
