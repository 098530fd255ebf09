"""Drivers and traffic demand, with the speed and spacing that belong to it.

The relation between density and speed is the triangular one that the improved intelligent driver model has in
equilibrium (Treiber and Kesting, Traffic Flow Dynamics, 2013, chapter 11): gap = minimum gap + speed x time headway
up to the desired speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from pydantic import ConfigDict, Field

from harness.common.errors import InputError
from harness.storage.schema import DENSITY_RANGE
from mmpf.options.base import WithoutTruthValues

DEFAULT_DENSITY = 30.0
ROUNDING = 4.0
VEHICLE_LENGTH_M = 4.64


class NetworkTable(WithoutTruthValues):
    """A table of a network's files: without further entries, and without numbers that are not finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Drivers(NetworkTable):
    """Means and spreads that each driver's own style is drawn from: the table ``[drivers]`` of ``network.toml``.

    Speeds and flows are those of one lane in equilibrium, by the means over its vehicles.

    Attributes:
        headway_s: Mean time headway kept beyond the minimum gap.
        free_speed_mps: Mean speed of free traffic; slow vehicles keep it below the limit.
        desired_speed_spread: Standard deviation of a driver's desired speed as a share of the limit.
        acceleration_scale: Largest accelerations over those usual for each kind of vehicle.
        assertiveness: How much smaller than their own the gaps are that drivers change lanes into, SUMO's
            ``lcAssertive``; what the vehicle types say if left out.
    """

    headway_s: float = Field(default=1.35, ge=0.8, le=2.6)
    headway_spread_s: float = Field(default=0.35, ge=0.0, le=1.0)
    minimum_gap_m: float = Field(default=2.8, ge=1.4, le=6.0)
    minimum_gap_spread_m: float = Field(default=0.5, ge=0.0, le=2.0)
    free_speed_mps: float = Field(default=27.0, ge=10.0, le=50.0)
    desired_speed_spread: float = Field(default=0.08, ge=0.0, le=0.2)
    acceleration_scale: float = Field(default=1.0, ge=0.5, le=2.5)
    assertiveness: float | None = Field(default=None, ge=0.2, le=8.0)

    @property
    def standing_spacing_m(self) -> float:
        """Front-to-front distance at standstill."""
        return VEHICLE_LENGTH_M + self.minimum_gap_m

    @property
    def critical_density_veh_per_km(self) -> float:
        """Density at capacity: below it traffic is free, above it congested."""
        return 1000.0 / (self.standing_spacing_m + self.free_speed_mps * self.headway_s)

    @property
    def wave_speed_mps(self) -> float:
        """Speed at which congestion waves travel upstream."""
        return self.standing_spacing_m / self.headway_s

    def speed_mps(self, density_veh_per_km: float) -> float:
        """Return the speed at a density, the corner at capacity rounded off since desired speeds differ."""
        following = max(0.5, (1000.0 / density_veh_per_km - self.standing_spacing_m) / self.headway_s)
        return float((self.free_speed_mps**-ROUNDING + following**-ROUNDING) ** (-1.0 / ROUNDING))

    def flow_veh_per_s(self, density_veh_per_km: float) -> float:
        """Return one lane's flow at a density."""
        return density_veh_per_km / 1000.0 * self.speed_mps(density_veh_per_km)

    def congested_speed_mps(self, flow_veh_per_s: float) -> float:
        """Return the speed of congested traffic that carries a flow; the free speed at or above capacity."""
        room = 1.0 - flow_veh_per_s * self.headway_s
        if room <= 0.0:
            return self.free_speed_mps
        return min(self.free_speed_mps, flow_veh_per_s * self.standing_spacing_m / room)


@dataclass(frozen=True)
class Demand:
    """Traffic to be held on a section.

    Attributes:
        wave_amplitude: How far density swings about its mean along the road at first, as a share of the mean.
        exit_wave_amplitude: How far the flow that leaves swings about its mean from then on, as a share of the mean.
        schedule: Times from the first frame on, ascending from 0, the densities to be held from then on, and how strong
            the exit's waves are then, as a share of their amplitude; none where all stays the same.
        headway_profile: Positions along the road and what drivers' time headways are multiplied by there, linear in
            between: where drivers keep larger gaps lies the bottleneck.
    """

    density_veh_per_km_lane: float
    on_ramp_veh_per_h: float
    off_ramp_veh_per_h: float
    wave_amplitude: float
    exit_wave_amplitude: float
    wave_period_s: float
    schedule: tuple[tuple[float, float, float], ...] = ()
    headway_profile: tuple[tuple[float, float], ...] = ()

    def at(self, time_s: float) -> Demand:
        """Return the demand with the density and the waves that the schedule has at a time."""
        begun = [entry for entry in self.schedule if entry[0] <= max(0.0, time_s)]
        if not begun:
            return self
        _, density, share = begun[-1]
        return replace(self, density_veh_per_km_lane=density, exit_wave_amplitude=share * self.exit_wave_amplitude)


def demand_for_density(density_veh_per_km_lane: float, lanes: int = 5, drivers: Drivers | None = None) -> Demand:
    """Return the demand that ``density`` asks for: ramp flows and waves that go with the density.

    Raises:
        InputError: The density is not a number or out of range.
    """
    lowest, highest = DENSITY_RANGE
    if not (math.isfinite(density_veh_per_km_lane) and lowest <= density_veh_per_km_lane <= highest):
        raise InputError(
            f"`density` {density_veh_per_km_lane:g} is out of range: give {lowest:g} to {highest:g} "
            "vehicles per km and lane"
        )
    drivers = drivers or Drivers()
    main_flow_veh_per_h = 3600.0 * lanes * drivers.flow_veh_per_s(density_veh_per_km_lane)
    congestion = (density_veh_per_km_lane - drivers.critical_density_veh_per_km) / 25.0
    amplitude = 0.65 * min(1.0, max(0.0, congestion))
    return Demand(
        density_veh_per_km_lane=density_veh_per_km_lane,
        on_ramp_veh_per_h=min(600.0, 0.06 * main_flow_veh_per_h),
        off_ramp_veh_per_h=min(380.0, 0.035 * main_flow_veh_per_h),
        wave_amplitude=amplitude,
        exit_wave_amplitude=0.5 * amplitude,
        wave_period_s=45.0,
    )
