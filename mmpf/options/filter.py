"""The filter's settings: all numbers that belong to neither the sensor nor the motion model.

The groups of ``FilterOptions`` itself hold for both update rules, those of ``joint`` and ``max_likelihood`` for one.
"""

from typing import Annotated, Literal, Self

from pydantic import Field

from mmpf.options.base import NotNegative, Positive, Probability, Settings, in_unit
from mmpf.options.joint import JointOptions
from mmpf.options.paper import MaxLikelihoodOptions

UpdateName = Literal["joint", "max_likelihood"]


class Footprint(Settings):
    """The rectangle that stands for a vehicle whose size is not measured: the mean and spread on US-101."""

    length_m: Positive = 4.7
    """Mean length."""
    width_m: Positive = 1.9
    """Mean width."""
    std_length_m: Positive = 2.0
    """Spread of lengths, wide enough for trucks; measured lengths narrow it down."""
    std_width_m: Positive = 0.3
    """Spread of widths."""


MEAN_CAR = Footprint()
OTHER_SPEED_ERROR = 0.4


class ModelErrorOptions(Settings):
    """Noise that the filter adds to every motion model's prediction, since no model is the truth.

    Root spectral densities of white noise: a standard deviation over one second grows with the root of time.
    """

    speed: Annotated[NotNegative | None, in_unit("m/s/√s")] = None
    """Noise on the longitudinal speed. None selects the value that was better on the tuning seeds: 0 under the joint
    rule for a model that spreads the speed itself (``mmpf.motion.protocol.spreads_speed``), such as the learned driver;
    0.4 otherwise.
    """
    accel: Annotated[NotNegative, in_unit("m/s²/√s")] = 1.2
    """Noise on the longitudinal acceleration."""
    lat_speed: Annotated[NotNegative, in_unit("m/s/√s")] = 0.2
    """Noise on the lateral speed."""
    hidden_lon_factor: NotNegative = 1.3
    """Factor on the longitudinal noise of undetected components, whose position comes from the model alone."""

    def with_speed(self, otherwise: float = OTHER_SPEED_ERROR) -> Self:
        """Return the settings with a number for the speed, ``otherwise`` where none was set."""
        return self if self.speed is not None else self.model_copy(update={"speed": otherwise})


class BirthOptions(Settings):
    """How the particles of a new component are drawn around its detection."""

    local_speed_share: Probability = 0.6
    """Share of particles whose speed is drawn near the speed of the surrounding traffic."""
    local_speed_std_mps: Positive = 2.5
    """Spread of their speeds."""
    other_speed_std_mps: Positive = 8.0
    """Spread of the other particles' speeds; a prior from neighbours alone would miss vehicles in the fast lane."""
    standing_share: Probability = 0.1
    """Share of particles with zero speed, to detect broken-down cars in fast traffic."""
    lat_speed_std_mps: Positive = 0.4
    """Spread of the lateral speed."""
    accel_std_mps2: Positive = 0.7
    """Spread of the longitudinal acceleration."""
    local_range_m: Positive = 40.0
    """Tracks within this distance determine the speed of the surrounding traffic."""


class ReportingOptions(Settings):
    """When a component counts as hidden and which hidden ones are reported."""

    hidden_after_s: Positive = 0.25
    """A component without detections for longer counts as hidden: it is reported as hidden, its particles move like
    those of a hidden vehicle, and its speed is not used as traffic speed for newborn components.
    """
    reported_std_lon_m: Positive = 15.0
    """A hidden component with a wider spread is kept for re-acquisition but not reported."""
    reported_hidden_above: Probability = 0.05
    """A hidden component with a lower vehicle probability is kept but not reported."""
    hidden_variance_factor: Positive = 1.5
    """Factor on the reported variances of hidden tracks, since drivers do what no motion model foresees, such as lane
    changes. The default makes the errors on eight training runs of simulated traffic, at 20 and 45, most likely.
    """


class FilterOptions(Settings):
    """All settings of the Modified Mixture Particle Filter."""

    particles: Annotated[int, Field(ge=10, le=1_000_000)] = 1000
    """Particles per component."""
    update: UpdateName = "joint"
    """Name of the update rule. The paper's own is ``max_likelihood``."""
    vehicle: Footprint = Footprint()
    """Size of a vehicle before it is measured."""
    model_error: ModelErrorOptions = ModelErrorOptions()
    """Noise added to the motion model's prediction."""
    birth: BirthOptions = BirthOptions()
    """How new components are drawn."""
    reporting: ReportingOptions = ReportingOptions()
    """When a component counts as hidden and which hidden ones are reported."""
    joint: JointOptions = JointOptions()
    """Settings that only the joint update reads."""
    max_likelihood: MaxLikelihoodOptions = MaxLikelihoodOptions()
    """Settings that only the paper's update reads."""
