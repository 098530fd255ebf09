"""The intelligent driver model of Treiber, Hennecke and Helbing, Physical Review E 62 (2000), equations (2) and (3)."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files

import numpy as np

from mmpf.compute.arrays import FloatArray
from mmpf.motion.kinematics import HARDEST_BRAKING_MPS2, ProcessNoise, keep_lane, move_along, no_latents, process_noise
from mmpf.motion.protocol import Neighbour, Surroundings, motion_models
from mmpf.state import ACCEL, SPEED

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


SHORTEST_HEADWAY_S, LONGEST_HEADWAY_S = 0.3, 4.0
SLOWEST_MPS = 2.0


@dataclass(frozen=True)
class Adaptation:
    """What the adaptive model has beyond IDM.

    Attributes:
        lag_per_s: Rate at which acceleration approaches IDM's.
        leader_accel_share: Share of the leader's acceleration that is added.
        trust: How far the headway moves from the common one to what the first acceleration implies, 0 to 1.
    """

    lag_per_s: float
    leader_accel_share: float
    trust: float


@cache
def adaptive_parameters() -> tuple[IdmParameters, Adaptation]:
    """Return the committed parameters that were fitted to the training recordings."""
    tables = tomllib.loads(files("mmpf.models").joinpath("idm_adaptive.toml").read_text(encoding="utf-8"))
    return IdmParameters(**tables["driver"]), Adaptation(**tables["adaptation"])


@dataclass(frozen=True)
class AdaptiveDriver:
    """Adaptive IDM; its latent is the driver's time headway, zero until the first step.

    Attributes:
        driver: Parameters; the headway is the common one.
        adaptation: Lag, leader's acceleration and trust.
        noise: Drives the speeds, m/s per root second.
        name: Name in the registry.
        latent_size: The headway.
    """

    driver: IdmParameters = field(default_factory=lambda: adaptive_parameters()[0])
    adaptation: Adaptation = field(default_factory=lambda: adaptive_parameters()[1])
    noise: ProcessNoise = field(default_factory=lambda: process_noise("idm-adaptive"))
    name: str = "idm-adaptive"
    latent_size: int = 1

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Return headways that are set at the first step, when the leader is known: shape (1, n) of zeros."""
        return np.zeros((1, state.shape[1]))

    def propagate(
        self,
        state: FloatArray,
        latents: FloatArray,
        surroundings: Surroundings,
        dt_s: float,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray]:
        """Sample the states one step later; see ``MotionModel.propagate``."""
        headway = np.where(latents[0] == 0.0, self._implied_headway(state, surroundings), latents[0])
        leader = surroundings.leader
        wanted = idm_acceleration(state[SPEED], leader, self.driver, headway)
        wanted += np.where(
            leader.exists, self.adaptation.leader_accel_share * np.clip(leader.accel_mps2, -9.0, 5.0), 0.0
        )
        accel = state[ACCEL] + min(self.adaptation.lag_per_s * dt_s, 1.0) * (wanted - state[ACCEL])
        kick = self.noise.lon * np.sqrt(dt_s) * rng.standard_normal(state.shape[1])
        after = np.empty_like(state)
        move_along(state, after, accel, kick, dt_s)
        keep_lane(state, after, surroundings, self.noise, dt_s=dt_s, rng=rng)
        return after, headway[None]

    def _implied_headway(self, state: FloatArray, surroundings: Surroundings) -> FloatArray:
        """Return the headway with which IDM gives the present acceleration, drawn towards the common one."""
        driver, leader, speed = self.driver, surroundings.leader, state[SPEED]
        accel = state[ACCEL] - self.adaptation.leader_accel_share * leader.accel_mps2
        accel = np.clip(accel, -2.0 * driver.max_accel_mps2, 0.95 * driver.max_accel_mps2)
        left_for_leader = 1.0 - (speed / driver.desired_speed_mps) ** driver.exponent - accel / driver.max_accel_mps2
        gap = np.where(leader.exists, np.clip(leader.gap_m, 0.1, 200.0), 0.1)
        desired_gap = gap * np.sqrt(np.maximum(left_for_leader, 1e-3))
        closing = (
            speed * (speed - leader.speed_mps) / (2.0 * np.sqrt(driver.max_accel_mps2 * driver.comfortable_decel_mps2))
        )
        implied = (desired_gap - driver.standstill_gap_m - closing) / np.maximum(speed, SLOWEST_MPS)
        held = np.clip(implied, SHORTEST_HEADWAY_S, LONGEST_HEADWAY_S)
        common = driver.time_headway_s
        return np.where(leader.exists, common + self.adaptation.trust * (held - common), common)


motion_models.register("idm-adaptive")(AdaptiveDriver)
