"""Which components are removed."""

import numpy as np

from mmpf.belief.mixture import Components
from mmpf.belief.moments import Moments
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import BoolArray
from mmpf.options.joint import JointRemoval
from mmpf.stages.update_rule import Situation, outside_observation_area

LEAST_EXISTENCE = 0.02
"""A component below this existence probability is removed."""


def worth_keeping(components: Components, moments: Moments, situation: Situation, options: JointRemoval) -> BoolArray:
    """Return which components are kept: existing, near, recently seen and localised, shape (m,)."""
    left = outside_observation_area(moments.mean[LON], moments.mean[LAT], situation)
    patience_s = np.where(components.confirmed, options.longest_unseen_s, options.unconfirmed_unseen_s)
    return np.asarray(
        (components.existence >= LEAST_EXISTENCE)
        & (components.unseen_s <= patience_s)
        & (moments.std_along_m <= options.largest_std_lon_m)
        & ~left
    )
