"""Settings of the labelled multi-Bernoulli filter, readable without the package that has it."""

from harness.trackers.track_options import ExistenceOptions
from mmpf.options.base import Probability


class LmbOptions(ExistenceOptions):
    """Settings of the labelled multi-Bernoulli filter."""

    birth_existence: Probability = 0.05
    """Probability that a vehicle begins at a detection that no track claimed."""
