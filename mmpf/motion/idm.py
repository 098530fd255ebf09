"""The intelligent driver model of Treiber, Hennecke and Helbing, Physical Review E 62 (2000), equations (2) and (3)."""

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from mmpf.motion.kinematic import HARDEST_BRAKING_MPS2, ProcessNoise, committed_table, move_along, process_noise
from mmpf.motion.protocol import Memoryless, Neighbour, Surroundings, offset_in_lane
from mmpf.motion.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, SPEED
from mmpf.numerics.arrays import FloatArray

SMALLEST_GAP_M = 0.1
LANE_ATTRACTION_PER_S2 = 0.1
LANE_DAMPING_PER_S = 0.7
SHORTEST_HEADWAY_S, LONGEST_HEADWAY_S = 0.3, 4.0
SLOWEST_MPS = 2.0


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
# As calibrated in Kesting, Treiber and Helbing, Phil. Trans. R. Soc. A 368 (2010).
KESTING_2010 = IdmParameters(120.0 / 3.6, 1.5, 1.4, 2.0)
# The highway column of Treiber and Kesting, "Traffic Flow Dynamics" (2013), table 11.2.
TREIBER_KESTING_2013 = IdmParameters(120.0 / 3.6, 1.0, 1.0, 1.5)


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
    headway = driver.time_headway_s if headway_s is None else headway_s
    dynamic_gap = np.maximum(speed_mps * headway + _closing_gap_m(speed_mps, leader, driver), 0.0)
    gap = np.maximum(leader.gap_m, SMALLEST_GAP_M)
    interaction = np.where(leader.exists, (driver.standstill_gap_m + dynamic_gap) / gap, 0.0) ** 2
    free_road = 1.0 - (speed_mps / driver.desired_speed_mps) ** driver.exponent
    accel: FloatArray = driver.max_accel_mps2 * (free_road - interaction)
    return np.maximum(accel, -HARDEST_BRAKING_MPS2)


def _closing_gap_m(speed_mps: FloatArray, leader: Neighbour, driver: IdmParameters) -> FloatArray:
    braking_scale = 2.0 * np.sqrt(driver.max_accel_mps2 * driver.comfortable_decel_mps2)
    return np.asarray(speed_mps * (speed_mps - leader.speed_mps) / braking_scale)


def intelligent_driver(
    driver: IdmParameters = TREIBER_2000, noise: ProcessNoise | None = None, name: str = "idm"
) -> Memoryless:
    """Return Longitudinal IDM with white acceleration noise; lateral slow return to the lane's centre.

    By default the driver is that of the original publication and the noise, m/s per root second, the committed one.
    """
    return Memoryless(name, partial(_idm_step, driver, noise or process_noise("idm")))


def idm_fitted() -> Memoryless:
    """Return IDM with the parameters fitted to the same recordings that the learned models were trained on."""
    driver = IdmParameters(**committed_table("idm_fitted.toml"))
    return intelligent_driver(driver, process_noise("idm-fitted"), "idm-fitted")


def _idm_step(
    driver: IdmParameters,
    noise: ProcessNoise,
    state: FloatArray,
    surroundings: Surroundings,
    dt_s: float,
    rng: np.random.Generator,
) -> FloatArray:
    accel = idm_acceleration(state[SPEED], surroundings.leader, driver)
    return _driven(state, accel, surroundings, noise, dt_s, rng)


def _driven(
    before: FloatArray,
    accel_mps2: FloatArray,
    surroundings: Surroundings,
    noise: ProcessNoise,
    dt_s: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Return the states after a step of given acceleration.

    Vehicles drift back to the middle of their lane as damped springs do; off every lane they only damp their lateral
    speed.
    """
    n = before.shape[1]
    lon_kick, lat_kick = (size * np.sqrt(dt_s) * rng.standard_normal(n) for size in (noise.lon, noise.lat))
    after = np.empty_like(before)
    move_along(before, after, accel_mps2, lon_kick, dt_s)
    offset = offset_in_lane(before[LAT], surroundings.lane_right_m, surroundings.lane_left_m)
    pull = -LANE_ATTRACTION_PER_S2 * offset - LANE_DAMPING_PER_S * before[LAT_SPEED]
    lat_speed = before[LAT_SPEED] + pull * dt_s + lat_kick
    after[LAT] = before[LAT] + 0.5 * dt_s * (before[LAT_SPEED] + lat_speed)
    after[LAT_SPEED] = lat_speed
    after[LAT_ACCEL] = pull
    return after


@dataclass(frozen=True)
class Adaptation:
    """What the adaptive model has beyond IDM.

    Attributes:
        lag_per_s: Rate at which acceleration approaches IDM's.
        leader_accel_share: Share of the leader's acceleration that is added.
        trust: How far the headway moves from the common one to what the first acceleration implies, 0 to 1.
        deviation_mps2: Standard deviation of what drivers want beside that, an autoregressive process of first order.
        deviation_s: How long it lasts: its autocorrelation falls by e in this time.
    """

    lag_per_s: float
    leader_accel_share: float
    trust: float
    deviation_mps2: float = 0.0
    deviation_s: float = 1.4


def adaptive_parameters() -> tuple[IdmParameters, Adaptation]:
    """Return the committed parameters that were fitted to the training recordings."""
    tables = committed_table("idm_adaptive.toml")
    return IdmParameters(**tables["driver"]), Adaptation(**tables["adaptation"])


@dataclass(frozen=True)
class AdaptiveDriver:
    """Adaptive IDM; its latents are the driver's time headway, zero until the first step, and its deviation.

    Attributes:
        driver: Parameters; the headway is the common one.
        adaptation: Lag, leader's acceleration and trust.
        noise: Drives the speeds, m/s per root second.
        name: Name in the registry.
        latent_size: Headway and deviation.
    """

    driver: IdmParameters = field(default_factory=lambda: adaptive_parameters()[0])
    adaptation: Adaptation = field(default_factory=lambda: adaptive_parameters()[1])
    noise: ProcessNoise = field(default_factory=lambda: process_noise("idm-adaptive"))
    name: str = "idm-adaptive"
    latent_size: int = 2

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return headways of zero, set at the first step, when the leader is known, and deviations: shape (2, n)."""
        deviation = self.adaptation.deviation_mps2 * rng.standard_normal(state.shape[1])
        return np.stack([np.zeros(state.shape[1]), deviation])

    def propagate(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Sample the states one step later; see ``MotionModel.propagate``."""
        headway = np.where(latents[0] == 0.0, self._implied_headway(state, surroundings), latents[0])
        leader = surroundings.leader
        wanted = idm_acceleration(state[SPEED], leader, self.driver, headway)
        wanted += np.where(
            leader.exists, self.adaptation.leader_accel_share * np.clip(leader.accel_mps2, -9.0, 5.0), 0.0
        )
        wanted += latents[1]
        accel = state[ACCEL] + min(self.adaptation.lag_per_s * dt_s, 1.0) * (wanted - state[ACCEL])
        kept = np.exp(-dt_s / self.adaptation.deviation_s)
        fresh = self.adaptation.deviation_mps2 * np.sqrt(1.0 - kept**2) * rng.standard_normal(len(headway))
        after = np.stack([headway, kept * latents[1] + fresh])
        return _driven(state, accel, surroundings, self.noise, dt_s, rng), after

    def _implied_headway(self, state: FloatArray, surroundings: Surroundings) -> FloatArray:
        """Return the headway with which IDM gives the present acceleration, drawn towards the common one."""
        driver, leader, speed = self.driver, surroundings.leader, state[SPEED]
        accel = state[ACCEL] - self.adaptation.leader_accel_share * leader.accel_mps2
        accel = np.clip(accel, -2.0 * driver.max_accel_mps2, 0.95 * driver.max_accel_mps2)
        left_for_leader = 1.0 - (speed / driver.desired_speed_mps) ** driver.exponent - accel / driver.max_accel_mps2
        gap = np.where(leader.exists, np.clip(leader.gap_m, 0.1, 200.0), 0.1)
        desired_gap = gap * np.sqrt(np.maximum(left_for_leader, 1e-3))
        spare = desired_gap - driver.standstill_gap_m - _closing_gap_m(speed, leader, driver)
        implied = spare / np.maximum(speed, SLOWEST_MPS)
        held = np.clip(implied, SHORTEST_HEADWAY_S, LONGEST_HEADWAY_S)
        common = driver.time_headway_s
        return np.where(leader.exists, common + self.adaptation.trust * (held - common), common)


IDM_KESTING_2010 = partial(intelligent_driver, KESTING_2010, name="idm-kesting-2010")
IDM_TREIBER_KESTING_2013 = partial(intelligent_driver, TREIBER_KESTING_2013, name="idm-treiber-kesting-2013")
