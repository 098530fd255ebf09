"""The role of a driver: beliefs in, commands out, and the registry of drivers."""

from dataclasses import dataclass
from typing import Protocol

from harness.common.named import without_method
from harness.decisions.belief import Belief
from mmpf.numerics.arrays import BoolArray, FloatArray
from mmpf.registry import Entry, Registry


@dataclass(frozen=True)
class Command:
    """What a driver would do at each of n steps, arrays of shape (n,).

    Attributes:
        accel_mps2: The acceleration that it demands.
        accepts_left: Whether it would take the gap in the lane to the left; never where there is no lane.
        accepts_right: The same to the right.
    """

    accel_mps2: FloatArray
    accepts_left: BoolArray
    accepts_right: BoolArray


class Driver(Protocol):
    """Decides at each step by what is believed at that step alone."""

    def command(self, belief: Belief) -> Command:
        """Return what it would do at each step of a belief."""


class DriverFactory(Protocol):
    """Builds a driver."""

    def __call__(self) -> Driver:
        """Return one."""


drivers: Registry[DriverFactory] = Registry(
    "driver",
    "harness.drivers",
    {
        "hdm": Entry(f"{__package__}.hdm:HumanDriver"),
        "idm": Entry(f"{__package__}.idm:IdmDriver"),
        "mobil": Entry(f"{__package__}.mobil:MobilDriver"),
    },
    "unknown; choose one of {known}, or module:factory for your own",
    without_method("command(belief)"),
)
