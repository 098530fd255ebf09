"""How the drivers of a network drive: means and spreads that each vehicle's own style is drawn from."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class Drivers(BaseModel):
    """The table ``[drivers]`` of ``network.toml``; what is left out is as in the defaults.

    Attributes:
        headway_s: Mean time headway kept beyond the minimum gap.
        headway_spread_s: Its standard deviation.
        minimum_gap_m: Mean gap at standstill.
        minimum_gap_spread_m: Its standard deviation.
        free_speed_mps: Mean speed of free traffic; slow vehicles keep it below the limit.
        desired_speed_spread: Standard deviation of a driver's desired speed as a share of the limit.
        acceleration_scale: Largest accelerations over those usual for each kind of vehicle.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    headway_s: float = Field(default=1.35, ge=0.8, le=2.6)
    headway_spread_s: float = Field(default=0.35, ge=0.0, le=1.0)
    minimum_gap_m: float = Field(default=2.8, ge=1.4, le=6.0)
    minimum_gap_spread_m: float = Field(default=0.5, ge=0.0, le=2.0)
    free_speed_mps: float = Field(default=27.0, ge=10.0, le=50.0)
    desired_speed_spread: float = Field(default=0.08, ge=0.0, le=0.2)
    acceleration_scale: float = Field(default=1.0, ge=0.5, le=2.0)
