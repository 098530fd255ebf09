"""Settings of the labelled multi-Bernoulli filter, readable without the package that has it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from harness.trackers.track_options import RivalOptions
from mmpf.options.base import Positive, Probability


class LmbOptions(RivalOptions):
    """Settings of the labelled multi-Bernoulli filter."""

    detection_probability: Probability | None = None
    """Detection probability; None takes the sensor's."""
    clutter_factor: Positive = 1.0
    """Clutter relative to the data sheet's."""
    stay_s: Positive = 60.0
    """Mean lifetime of a vehicle."""
    birth_existence: Probability = 0.05
    """Probability that a vehicle begins at a detection that no track claimed."""
    reported_existence: Probability = 0.5
    """Existence probability from which a track is reported."""
    least_existence: Annotated[float, Field(gt=0.0, lt=1.0)] = 1e-3
    """A track with a lower existence probability ends."""
