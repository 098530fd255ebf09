"""IDM made as strong as hand-building goes: a rival that takes each driver's headway from its first acceleration.

The acceleration follows the intelligent driver model's with a first-order lag, a share of the leader's acceleration is
added, and the time headway is set once for each particle so that the model reproduces the acceleration it starts with.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files

import numpy as np

from mmpf.motion.idm import IdmParameters, idm_acceleration
from mmpf.motion.kinematics import keep_lane, move_along
from mmpf.motion.process_noise import ProcessNoise, process_noise
from mmpf.motion.protocol import Surroundings, motion_models
from mmpf.road import FloatArray
from mmpf.state import ACCEL, SPEED

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
