"""The human driver model: it looks beyond its leader (Treiber, Kesting and Helbing, Physica A 360 (2006), section 2.4).

Of the human driver model this is the spatial anticipation: each vehicle ahead adds the interaction that it would cause
if it were the leader, at the sum of the clear gaps up to it. Gaps and headways are divided by the root of the sum of
1/j², so that a platoon in equilibrium drives at the gaps of the intelligent driver model. Reaction time and errors of
estimation are left out: what is judged is the tracker, not the driver.
"""

from dataclasses import replace

import numpy as np

from harness.decisions.belief import LEADERS, Belief
from harness.decisions.drivers.following import PARAMETERS, free_acceleration, interaction, safe_gap
from harness.decisions.drivers.protocol import Command
from mmpf.motion.kinematic import HARDEST_BRAKING_MPS2


class HumanDriver:
    """The multi-anticipative driver, which minds as many vehicles ahead as a belief holds."""

    def command(self, belief: Belief) -> Command:
        """Return what it would do; see ``Driver``."""
        spread = float(np.sqrt(sum(1.0 / j**2 for j in range(1, LEADERS + 1))))
        parameters = replace(
            PARAMETERS,
            time_headway_s=PARAMETERS.time_headway_s / spread,
            standstill_gap_m=PARAMETERS.standstill_gap_m / spread,
        )
        accel = free_acceleration(belief, belief.speed_mps)
        for j in range(LEADERS):
            accel = accel - interaction(belief.speed_mps, belief.leaders.at(j), parameters)
        accel = np.maximum(accel, -HARDEST_BRAKING_MPS2)
        return Command(accel, safe_gap(belief, belief.left), safe_gap(belief, belief.right))
