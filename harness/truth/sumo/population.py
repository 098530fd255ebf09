"""Vehicles and drivers: classes, sizes and driving styles, drawn for each vehicle."""

from dataclasses import dataclass

import numpy as np

from harness.truth.network.demand import Drivers


@dataclass(frozen=True)
class Vehicle:
    """One vehicle and its driver.

    Attributes:
        kind: ``car``, ``truck`` or ``motorcycle``: the base type's name.
        lateral_offset_m: Where in its lane the driver likes to be, from the middle, positive to the left.
        assertiveness: SUMO's ``lcAssertive``; None for what the vehicle's type says.
    """

    kind: str
    length_m: float
    width_m: float
    minimum_gap_m: float
    headway_s: float
    accel_mps2: float
    speed_factor: float
    lateral_offset_m: float
    assertiveness: float | None = None


@dataclass(frozen=True)
class Kind:
    """How one kind of vehicle is drawn: share of traffic, mean, spread and bounds of its size and style."""

    share: float
    length_m: tuple[float, float, float, float]
    width_m: tuple[float, float, float, float]
    accel_mps2: tuple[float, float, float, float]
    headway_scale: float
    speed_scale: float


# Shares and sizes follow the NGSIM US-101 recording: 97.0 % cars, 2.25 % trucks, 0.74 % motorcycles, over all of them
# length 4.64 +- 1.41 m with quartiles 4.1, 4.6 and 4.9 m, width 1.91 +- 0.28 m.
KINDS = {
    "car": Kind(0.9701, (4.51, 0.58, 3.3, 6.3), (1.905, 0.23, 1.45, 2.4), (1.5, 0.25, 0.9, 2.3), 1.0, 1.0),
    "truck": Kind(0.0225, (11.5, 4.0, 6.5, 20.0), (2.45, 0.15, 2.1, 2.6), (0.8, 0.12, 0.5, 1.1), 1.25, 0.9),
    "motorcycle": Kind(0.0074, (2.2, 0.2, 1.8, 2.6), (0.85, 0.1, 0.7, 1.1), (1.8, 0.25, 1.2, 2.4), 0.9, 1.03),
}


def draw_vehicle(rng: np.random.Generator, drivers: Drivers) -> Vehicle:
    """Draw one vehicle of a network's drivers."""
    kind = str(rng.choice(list(KINDS), p=[entry.share for entry in KINDS.values()]))
    entry = KINDS[kind]
    return Vehicle(
        kind=kind,
        length_m=_bounded_normal(rng, *entry.length_m),
        width_m=_bounded_normal(rng, *entry.width_m),
        minimum_gap_m=_bounded_normal(rng, drivers.minimum_gap_m, drivers.minimum_gap_spread_m, 1.4, 7.0),
        headway_s=entry.headway_scale * _bounded_normal(rng, drivers.headway_s, drivers.headway_spread_s, 0.8, 2.6),
        accel_mps2=drivers.acceleration_scale * _bounded_normal(rng, *entry.accel_mps2),
        speed_factor=entry.speed_scale * _bounded_normal(rng, 1.0, drivers.desired_speed_spread, 0.8, 1.2),
        lateral_offset_m=_bounded_normal(rng, 0.0, 0.25, -0.5, 0.5),
        assertiveness=drivers.assertiveness,
    )


def _bounded_normal(rng: np.random.Generator, mean: float, spread: float, lowest: float, highest: float) -> float:
    return round(float(np.clip(rng.normal(mean, spread), lowest, highest)), 3)
