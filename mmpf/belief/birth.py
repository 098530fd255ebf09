"""New components: particles drawn around detections that no component explains."""

from dataclasses import dataclass

import numpy as np

from mmpf.belief.mixture import Components, Mixture, ParticleCloud
from mmpf.belief.sizes import with_measured_sizes
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion.protocol import MotionModel, TakesHeadings
from mmpf.motion.state import ACCEL, LAT, LAT_SPEED, LON, SPEED, STATE_SIZE
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, taken, turned
from mmpf.options.filter import BirthOptions, FilterOptions
from mmpf.scan import Detections

# Speeds of particles that stand scatter by so much.
STANDING_STD_MPS = 0.5
FIRST_EXISTENCE = 0.5
"""Existence probability of components born in the first scan."""


@dataclass(frozen=True)
class Traffic:
    """Speeds around a birth place, struct of arrays over k vehicles including the ego.

    Attributes:
        lon_m: Longitudinal positions, shape (k,).
        speed_mps: Speeds, shape (k,).
        lat_m: Lateral positions, shape (k,), where they matter as much: in the plane. None along one road.
    """

    lon_m: FloatArray
    speed_mps: FloatArray
    lat_m: FloatArray | None = None


@dataclass(frozen=True)
class Births:
    """Which detections start a component.

    Attributes:
        detections: The scan's detections.
        chosen: Indices of those that start one, shape (k,).
        components: What the rule keeps of the new components, k of them, before any size is measured.
        traffic: Speeds around.
    """

    detections: Detections
    chosen: IntArray
    components: Components
    traffic: Traffic


def lies_on_ego(detections: Detections, plane: SensorPlane) -> BoolArray:
    """Return which detections lie on the ego itself, where no other vehicle can be, shape (d,)."""
    ego = plane.ego
    along, across = turned(detections.lon_m - ego.lon_m, detections.lat_m - ego.lat_m, plane.ego_turn_rad)
    return np.asarray((np.abs(along) < 0.5 * ego.length_m) & (np.abs(across) < 0.5 * ego.width_m))


def give_birth(
    mixture: Mixture,
    keep: BoolArray,
    births: Births,
    motion: MotionModel,
    options: FilterOptions,
    rng: np.random.Generator,
) -> Mixture:
    """Add one component for each chosen detection and remove those not kept, with one copy of all particles.

    Where the sensor measures no speed, it is drawn partly near the speed of the traffic around and partly from
    everything that is possible: a prior near the neighbours alone loses the fast lane.

    Args:
        mixture: The belief so far.
        keep: Components that stay, shape (m,).
        births: Where the new components start.
        motion: Draws the latents of the new particles.
        options: How many particles are drawn, and how widely.
        rng: Source of randomness.
    """
    detections, chosen, particles = births.detections, births.chosen, options.particles
    if len(chosen) == 0:
        return mixture.keep(keep)
    state = _draw_states(births, particles, options.birth, rng)
    latents = motion.draw_latents(state, rng)
    if isinstance(motion, TakesHeadings) and detections.headings is not None:
        latents = motion.towards(latents, taken(detections.headings, chosen), rng)
    even = np.full(state.shape[1], -np.log(particles))
    cloud = ParticleCloud(
        state=state,
        log_weight=even,
        log_raw_weight=even,
        component=np.repeat(np.arange(len(chosen)), particles),
        log_component_weight=np.full(state.shape[1], -np.log(keep.sum() + len(chosen))),
        latents=latents,
    )
    components = births.components
    if detections.sizes is not None:
        components = with_measured_sizes(components, np.arange(len(chosen)), taken(detections.sizes, chosen))
    return mixture.keep_and_join(keep, cloud, components)


def _draw_states(births: Births, particles: int, options: BirthOptions, rng: np.random.Generator) -> FloatArray:
    detections, chosen = births.detections, births.chosen
    shape = (len(chosen), particles)

    def normal(mean: FloatArray, std: FloatArray | float) -> FloatArray:
        spread = np.broadcast_to(std, mean.shape)
        return mean[:, None] + spread[:, None] * rng.standard_normal(shape)

    flow = local_speed(detections.lon_m[chosen], detections.lat_m[chosen], births.traffic, options.local_range_m)
    near = normal(flow, options.local_speed_std_mps)
    anything = normal(flow, options.other_speed_std_mps)
    chance = rng.uniform(size=shape)
    speed = np.where(chance < options.local_speed_share, near, anything)
    stands = chance > 1.0 - options.standing_share
    speed[stands] = np.abs(STANDING_STD_MPS * rng.standard_normal(int(stands.sum())))
    measured = np.isfinite(detections.speed_mps[chosen])
    around_measurement = normal(
        np.nan_to_num(detections.speed_mps[chosen]), np.nan_to_num(detections.std_speed_mps[chosen])
    )
    speed = np.where(measured[:, None], around_measurement, speed)

    state = np.empty((STATE_SIZE, *shape))
    state[LON] = normal(detections.lon_m[chosen], detections.std_lon_m[chosen])
    state[LAT] = normal(detections.lat_m[chosen], detections.std_lat_m[chosen])
    if detections.correlation is not None:
        rho = detections.correlation[chosen, None]
        slope = rho * (detections.std_lat_m / detections.std_lon_m)[chosen, None]
        off_lon = state[LON] - detections.lon_m[chosen, None]
        off_lat = state[LAT] - detections.lat_m[chosen, None]
        state[LAT] += slope * off_lon + (np.sqrt(1.0 - rho**2) - 1.0) * off_lat
    state[SPEED] = np.maximum(speed, 0.0)
    state[LAT_SPEED] = options.lat_speed_std_mps * rng.standard_normal(shape)
    state[ACCEL] = options.accel_std_mps2 * rng.standard_normal(shape)
    state[-1] = 0.0
    return state.reshape(STATE_SIZE, -1)


def local_speed(lon_m: FloatArray, lat_m: FloatArray, traffic: Traffic, range_m: float) -> FloatArray:
    """Return the mean speed of traffic around places, weighted by nearness, shape (k,)."""
    away = ((lon_m[:, None] - traffic.lon_m[None, :]) / range_m) ** 2
    if traffic.lat_m is not None:
        away += ((lat_m[:, None] - traffic.lat_m[None, :]) / range_m) ** 2
    weight = np.exp(-0.5 * away) + 1e-9
    return np.asarray((weight * traffic.speed_mps).sum(axis=1) / weight.sum(axis=1))
