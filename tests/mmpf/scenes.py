"""Small scenes with a known answer for the filter's tests."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from mmpf.belief.mixture import Mixture, ParticleCloud
from mmpf.joint.sources import Sources
from mmpf.map.corridor_road import highway
from mmpf.motion.protocol import Surroundings
from mmpf.motion.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED, STATE_SIZE
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import Detections, EgoPose, Scan
from mmpf.tracks import CONFIRMED, Tracks

ROAD = highway()
LANE_WIDTH_M = 3.66


def lane_centre(lane_from_right: int) -> float:
    return (lane_from_right + 0.5) * LANE_WIDTH_M


def ego_at(lon_m: float = 0.0, lat_m: float = lane_centre(2), speed_mps: float = 20.0) -> EgoPose:
    return EgoPose(lon_m, lat_m, 0.0, speed_mps, 4.7, 1.9)


def detections_at(positions: list[tuple[float, float]], std_lon_m: float = 0.3, std_lat_m: float = 0.2) -> Detections:
    lon, lat = (np.array(positions, dtype=np.float64).reshape(-1, 2)).T
    unmeasured = np.full(len(lon), np.nan)
    return Detections(
        lon, lat, unmeasured, np.full(len(lon), std_lon_m), np.full(len(lon), std_lat_m), unmeasured.copy()
    )


def scan_of(time_s: float, positions: list[tuple[float, float]], ego: EgoPose | None = None) -> Scan:
    return Scan(time_s, detections_at(positions), ego or ego_at())


def tracks_of(lon_m: ArrayLike, lat_m: ArrayLike, **columns: ArrayLike) -> Tracks:
    """Return confirmed tracks from number 1 on that are surely there, at 20 m/s unless their columns are given."""
    count = len(np.atleast_1d(lon_m))
    made: dict[str, ArrayLike] = {
        "track_id": np.arange(1, count + 1), "lon_m": lon_m, "lat_m": lat_m, "speed_mps": 20.0, "lat_speed_mps": 0.0,
        "accel_mps2": 0.0, "std_lon_m": 0.3, "std_lat_m": 0.3, "std_speed_mps": 0.3, "existence": 1.0,
        "state": CONFIRMED, **columns,
    }  # fmt: skip
    types = {"track_id": np.int64, "state": np.int8}
    return Tracks(**{name: np.full(count, value, types.get(name, np.float64)) for name, value in made.items()})


def belief_of(
    states: Sequence[FloatArray], weights: Sequence[FloatArray] | None = None, **columns: Sequence[float]
) -> Mixture:
    """A belief of one component for each array of states (6, k); ``columns`` are those of ``Sources``, by name."""
    sizes = [state.shape[1] for state in states]
    own_weights = weights if weights is not None else [np.full(size, 1.0 / size) for size in sizes]
    weight = np.concatenate([np.zeros(0), *own_weights])
    component = np.repeat(np.arange(len(sizes)), sizes)
    state = np.concatenate([np.zeros((STATE_SIZE, 0)), *states], axis=1)
    log_component_weight = np.full(len(component), -np.log(max(len(sizes), 1)))
    cloud = ParticleCloud(
        state, np.log(weight), np.log(weight), component, log_component_weight, np.zeros((0, len(component)))
    )
    components = Sources.newborn(np.arange(1, len(sizes) + 1), np.full(len(sizes), 0.9))
    return Mixture(cloud, replace(components, **{name: np.array(values) for name, values in columns.items()}), 100)


def spot(lon_m: float, lat_m: float, speed_mps: float = 20.0, particles: int = 10) -> FloatArray:
    """States of particles that are all in one place, shape (6, particles)."""
    state = np.zeros((STATE_SIZE, particles))
    state[LON], state[LAT], state[SPEED] = lon_m, lat_m, speed_mps
    return state


@dataclass(frozen=True)
class LinearGaussianMotion:
    """Constant velocity with white Gaussian speed noise: a model whose exact filter is Kalman's."""

    speed_std_mps: float = 0.2
    name: str = "linear-gaussian"
    latent_size: int = 0

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        return np.zeros((0, state.shape[1]))

    def propagate(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        after = state.copy()
        after[LON] += dt_s * state[SPEED]
        after[LAT] += dt_s * state[LAT_SPEED]
        after[SPEED] += self.speed_std_mps * rng.standard_normal(state.shape[1])
        after[LAT_SPEED] += 0.1 * self.speed_std_mps * rng.standard_normal(state.shape[1])
        after[[ACCEL, LAT_ACCEL]] = 0.0
        return after, latents
