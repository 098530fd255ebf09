"""The intelligent driver model of Treiber, Hennecke and Helbing, Physical Review E 62 (2000), equations (2) and (3)."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files

import numpy as np

from mmpf.motion.kinematics import HARDEST_BRAKING_MPS2, keep_lane, move_along, no_latents
from mmpf.motion.process_noise import ProcessNoise, process_noise
from mmpf.motion.protocol import Neighbour, Surroundings, motion_models
from mmpf.road import FloatArray
from mmpf.state import SPEED

SMALLEST_GAP_M = 0.1


@dataclass(frozen=True)
class IdmParameters:
    """A driver in the intelligent driver model.

    Attributes:
        desired_speed_mps: Speed on a free road.
        time_headway_s: Safe time headway.
        max_accel_mps2: Maximum acceleration.
        comfortable_decel_mps2: Desired deceleration, positive.
        exponent: Acceleration exponent.
        standstill_gap_m: Jam distance.
    """

    desired_speed_mps: float
    time_headway_s: float
    max_accel_mps2: float
    comfortable_decel_mps2: float
    exponent: float = 4.0
    standstill_gap_m: float = 2.0


TREIBER_2000 = IdmParameters(120.0 / 3.6, 1.6, 0.73, 1.67)
KESTING_2010 = IdmParameters(120.0 / 3.6, 1.5, 1.4, 2.0)
TREIBER_KESTING_2013 = IdmParameters(120.0 / 3.6, 1.0, 1.0, 1.5)


@cache
def fitted_parameters() -> IdmParameters:
    """Return the committed parameters that were fitted to the training recordings."""
    text = files("mmpf.models").joinpath("idm_fitted.toml").read_text(encoding="utf-8")
    return IdmParameters(**tomllib.loads(text))


def idm_acceleration(
    speed_mps: FloatArray, leader: Neighbour, driver: IdmParameters, headway_s: FloatArray | None = None
) -> FloatArray:
    """Return the acceleration that the model demands, no harder than a car can brake, shape (n,).

    Args:
        speed_mps: Own speeds, shape (n,).
        leader: Vehicles ahead; a missing one leaves the free-road term alone.
        driver: Parameters.
        headway_s: Each vehicle's own time headway, shape (n,); None for the driver's.
    """
    closing_term = speed_mps * (speed_mps - leader.speed_mps)
    braking_scale = 2.0 * np.sqrt(driver.max_accel_mps2 * driver.comfortable_decel_mps2)
    headway = driver.time_headway_s if headway_s is None else headway_s
    dynamic_gap = np.maximum(speed_mps * headway + closing_term / braking_scale, 0.0)
    gap = np.maximum(leader.gap_m, SMALLEST_GAP_M)
    interaction = np.where(leader.exists, (driver.standstill_gap_m + dynamic_gap) / gap, 0.0) ** 2
    free_road = 1.0 - (speed_mps / driver.desired_speed_mps) ** driver.exponent
    accel: FloatArray = driver.max_accel_mps2 * (free_road - interaction)
    return np.maximum(accel, -HARDEST_BRAKING_MPS2)


@dataclass(frozen=True)
class IntelligentDriver:
    """IDM along the road with white acceleration noise; across it, a slow return to the lane's middle.

    Attributes:
        driver: Parameters, those of the original publication by default.
        noise: Drives the speeds, m/s per root second.
        name: Name in the registry.
        latent_size: No latents.
    """

    driver: IdmParameters = TREIBER_2000
    noise: ProcessNoise = field(default_factory=lambda: process_noise("idm"))
    name: str = "idm"
    latent_size: int = 0

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Return no latents, shape (0, n)."""
        return no_latents(state)

    def propagate(
        self,
        state: FloatArray,
        latents: FloatArray,
        surroundings: Surroundings,
        dt_s: float,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray]:
        """Sample the states one step later; see ``MotionModel.propagate``."""
        accel = idm_acceleration(state[SPEED], surroundings.leader, self.driver)
        kick = self.noise.lon * np.sqrt(dt_s) * rng.standard_normal(state.shape[1])
        after = np.empty_like(state)
        move_along(state, after, accel, kick, dt_s)
        keep_lane(state, after, surroundings, self.noise, dt_s=dt_s, rng=rng)
        return after, latents


def idm_kesting_2010() -> IntelligentDriver:
    """Return IDM as calibrated in Kesting, Treiber and Helbing, Phil. Trans. R. Soc. A 368 (2010)."""
    return IntelligentDriver(driver=KESTING_2010, name="idm-kesting-2010")


def idm_treiber_kesting_2013() -> IntelligentDriver:
    """Return IDM with the highway column of Treiber and Kesting, "Traffic Flow Dynamics" (2013), table 11.2."""
    return IntelligentDriver(driver=TREIBER_KESTING_2013, name="idm-treiber-kesting-2013")


def idm_fitted() -> IntelligentDriver:
    """Return IDM with the parameters fitted to the same recordings that the learned models were trained on."""
    return IntelligentDriver(driver=fitted_parameters(), noise=process_noise("idm-fitted"), name="idm-fitted")


motion_models.register("idm")(IntelligentDriver)
motion_models.register("idm-kesting-2010")(idm_kesting_2010)
motion_models.register("idm-treiber-kesting-2013")(idm_treiber_kesting_2013)
motion_models.register("idm-fitted")(idm_fitted)
