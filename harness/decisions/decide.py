"""The decision: the driver of that name, asked with a belief."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.decisions import drivers as _registered  # noqa: F401  they register themselves
from harness.decisions.belief import LEADERS, Belief, believe
from harness.decisions.bodies import Bodies, Egos
from harness.decisions.drivers.protocol import Command, Driver, drivers
from harness.errors import InputError
from mmpf.compute.arrays import FloatArray, IntArray
from mmpf.registry import UnknownNameError
from mmpf.road import Road


@dataclass(frozen=True)
class Decision:
    """What a driver would do, and what by.

    Attributes:
        belief: What it took for real.
        command: What it would do.
    """

    belief: Belief
    command: Command


def driver_of(name: str) -> Driver:
    """Return a fresh driver.

    Args:
        name: One of ``drivers``, or ``module:factory`` for one's own.

    Raises:
        InputError: There is none of that name, or it can't be built.
    """
    if name == "sumo":
        raise InputError(
            f"`driver` sumo: SUMO's own model answers within a running simulation alone; choose one of "
            f"{', '.join(drivers)}, or module:factory for your own"
        )
    if ":" not in name and name not in set(drivers):
        raise InputError(
            f"`driver` {name}: unknown; choose one of {', '.join(drivers)}, or module:factory for your own"
        )
    try:
        driver = drivers[name]()
    except UnknownNameError as error:
        raise InputError(f"`driver` {name}: {error}") from None
    except Exception as error:
        raise InputError(f"`driver` {name}: it can't be built ({type(error).__name__}: {error}); mend it") from error
    if not callable(getattr(driver, "command", None)):
        raise InputError(f"`driver` {name}: it returned {type(driver).__name__}, which has no method command(belief)")
    return driver


def decide(driver: Driver, bodies: Bodies, egos: Egos, road: Road) -> Decision:
    """Ask a driver at each step.

    Args:
        driver: The driver.
        bodies: What it takes for real.
        egos: The ego, which it knows.
        road: The lanes.

    Raises:
        ValueError: What it would do is no finite number at each step.
    """
    return decide_by(driver, believe(bodies, egos, road))


def decide_by(driver: Driver, belief: Belief) -> Decision:
    """Ask a driver with a belief.

    Raises:
        ValueError: What it would do is no finite number at each step.
    """
    command = driver.command(belief)
    if np.shape(command.accel_mps2) != (len(belief),) or not np.isfinite(command.accel_mps2).all():
        raise ValueError(f"the driver {type(driver).__name__} returned no finite acceleration for each step")
    return Decision(belief, command)


def most_decisive(driver: Driver, belief: Belief) -> IntArray:
    """Return the body ahead without which the driver would brake least, shape (n,); -1 where none matters."""
    own = driver.command(belief).accel_mps2
    relief: FloatArray = np.stack([driver.command(belief.without(j)).accel_mps2 - own for j in range(LEADERS)], axis=1)
    best = relief.argmax(axis=1)
    rows = np.arange(len(belief))
    return np.where(relief[rows, best] > 0.0, belief.leaders.body[rows, best], -1)
