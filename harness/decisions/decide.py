"""Asks the named driver for a command, given a belief.

A driver brakes as hard as it must for what is surely there, and slows down for what may be: for a body that is more
likely no vehicle than one it brakes comfortably at most.
"""

from dataclasses import dataclass, replace

import numpy as np

from harness.common.errors import InputError
from harness.common.named import check_made, named
from harness.decisions.belief import LEADERS, Belief, believe
from harness.decisions.bodies import Bodies, Egos
from harness.decisions.drivers.following import PARAMETERS
from harness.decisions.drivers.protocol import Command, Driver, drivers
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, IntArray

GENTLE_MPS2 = PARAMETERS.comfortable_decel_mps2
"""Hardest braking for a doubtful body: 1.5 m/s², the driver's comfortable one."""


@dataclass(frozen=True)
class Decision:
    """What a driver would do, and the belief that it would do it by."""

    belief: Belief
    command: Command


def driver_of(name: str) -> Driver:
    """Return a fresh driver of a name in ``drivers``, or of ``module:factory``.

    Raises:
        InputError: There is none of that name, or it can't be built.
    """
    if name == "sumo":
        raise InputError(
            f"`driver` sumo: SUMO's own model answers within a running simulation alone; choose one of "
            f"{', '.join(drivers)}, or module:factory for your own"
        )
    factory = named(drivers, "driver", name)
    try:
        driver = factory()
    except Exception as error:
        raise InputError(f"`driver` {name}: it can't be built ({type(error).__name__}: {error}); fix it") from error
    check_made(drivers, "driver", name, driver)
    return driver


def decide(driver: Driver, bodies: Bodies, egos: Egos, road: Road) -> Decision:
    """Return the driver's command at each step.

    The belief, and with it which gaps beside the ego are accepted, is of the bodies that are sure.

    Raises:
        ValueError: What it would do is no finite number at each step.
    """
    decision = decide_by(driver, believe(bodies.sure(), egos, road))
    if not bodies.has_doubtful:
        return decision
    accel_mps2 = with_doubt(decision, decide_by(driver, believe(bodies, egos, road)))
    return replace(decision, command=replace(decision.command, accel_mps2=accel_mps2))


def decide_by(driver: Driver, belief: Belief) -> Decision:
    """Return the driver's command for a belief.

    Raises:
        ValueError: What it would do is no finite number at each step.
    """
    command = driver.command(belief)
    if np.shape(command.accel_mps2) != (len(belief),) or not np.isfinite(command.accel_mps2).all():
        raise ValueError(f"the driver {type(driver).__name__} returned no finite acceleration for each step")
    return Decision(belief, command)


def with_doubt(sure: Decision, all_: Decision) -> FloatArray:
    """Return the acceleration that a driver demands by a decision on what is sure and one on all bodies, shape (n,)."""
    gently = np.maximum(all_.command.accel_mps2, -GENTLE_MPS2)
    return np.asarray(np.minimum(sure.command.accel_mps2, gently))


def most_decisive(driver: Driver, belief: Belief) -> IntArray:
    """Return the body ahead without which the driver would brake least, shape (n,); -1 where none matters."""
    own = driver.command(belief).accel_mps2
    relief: FloatArray = np.stack([driver.command(belief.without(j)).accel_mps2 - own for j in range(LEADERS)], axis=1)
    best = relief.argmax(axis=1)
    rows = np.arange(len(belief))
    return np.where(relief[rows, best] > 0.0, belief.leaders.body[rows, best], -1)
