"""The filter's belief: particles and components, struct of arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from mmpf.belief.kinds import KINDS, LEVELS, certain_vehicles, vehicle_share
from mmpf.motion.state import STATE_SIZE
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, joined, taken
from mmpf.options.filter import MEAN_CAR, Footprint

NEVER = -1
# Times are sums of steps, which are no round numbers.
ROUNDING_S = 1e-6


@dataclass(frozen=True)
class ParticleCloud:
    """All particles of all components, struct of arrays over n particles, those of one component side by side.

    The paper's self-contained particle p = [x, w, w~, c, pi] (section II-B), weights as logarithms.

    Attributes:
        state: x, shape (6, n): longitudinal and lateral position, speed, acceleration; rows ``LON`` to ``LAT_ACCEL``.
        log_weight: log w, which sums to one within each component, shape (n,).
        log_raw_weight: log w~ of equation (10), shape (n,).
        component: c, index of the particle's component, ascending, shape (n,).
        log_component_weight: log pi of the particle's component, shape (n,).
        latents: What the motion model carries beside the state, shape (latent_size, n).
    """

    state: FloatArray
    log_weight: FloatArray
    log_raw_weight: FloatArray
    component: IntArray
    log_component_weight: FloatArray
    latents: FloatArray

    def __len__(self) -> int:
        return len(self.component)

    def starts(self, components: int) -> IntArray:
        """Return where each component's particles begin, and the end of the last, shape (components + 1,)."""
        return np.searchsorted(self.component, np.arange(components + 1))

    def take(self, particles: IntArray, component: IntArray) -> ParticleCloud:
        """Return the chosen particles under new component indices, weights as they are.

        Args:
            particles: Indices of the particles to keep, shape (k,).
            component: Their components' new indices, ascending, shape (k,).
        """
        return ParticleCloud(
            state=self.state.take(particles, axis=1),
            log_weight=self.log_weight[particles],
            log_raw_weight=self.log_raw_weight[particles],
            component=component,
            log_component_weight=self.log_component_weight[particles],
            latents=self.latents.take(particles, axis=1),
        )

    def stretches(
        self, stretches: list[slice], component: IntArray, then: ParticleCloud | None = None
    ) -> ParticleCloud:
        """Return stretches of particles one after the other, then another cloud's, weights as they are.

        Args:
            stretches: Particles to keep.
            component: New component indices of all, ascending.
            then: What to put behind.
        """

        def one_after_the_other(name: str) -> FloatArray:
            values = getattr(self, name)
            parts = [values[..., :0], *(values[..., stretch] for stretch in stretches)]
            return np.concatenate(parts if then is None else [*parts, getattr(then, name)], axis=-1)

        columns = {f.name: one_after_the_other(f.name) for f in fields(self) if f.name != "component"}
        return ParticleCloud(component=component, **columns)


def is_longer(time_s: FloatArray, least_s: float) -> BoolArray:
    """Return which times have come up to a least time, but for rounding."""
    return np.asarray(time_s > least_s - ROUNDING_S)


@dataclass(frozen=True)
class Components:
    """What the filter keeps of each mixture component beside its particles, struct of arrays over m components.

    Attributes:
        track_id: Identity that is reported.
        existence: Probability that there is a source of detections: a vehicle, or a false object that stays.
        confirmed: Whether the component is reported as a track.
        withdrawn: Whether it was, until it was taken for a false object.
        hits: Scans in which a detection was attributed to it.
        detected_s: For how long it was detected after its birth: each hit counts for the time since the scan before.
        age_s: Time since its birth.
        unseen_s: Time since its last hit.
        missed: Probability that the sensor is in a run of misses of this vehicle.
        kinds: Probability of each kind of source with its detectability, given that there is one, shape (m, 3, 3,
            levels); see ``mmpf.belief.kinds``.
        ended: Probability that it was a false object that has ended, by kind and level, shape (m, 2, levels).
        speed_log: Log likelihood of its speed by kind, as it went into ``kinds``, shape (m, 3).
        standing_ratio: How much oftener a vehicle that stands appears where it did than one that moves.
        stood_log: Log likelihood, at most 0, that it stood at its fastest moment whose speed was well known.
        born_in_view: Degree, 0 to 1, to which it appeared in plain view.
        noise_factor: Measured noise over reported noise, from the innovations.
        noise_lon_m: Longitudinal deviation of its detections, smoothed, as reported and times that factor.
        noise_lat_m: The same, lateral.
        overlap_with: ``track_id`` of the component that it has been overlapping, ``NEVER`` if none.
        overlap_s: For how long, scan after scan.
        length_m: Estimated length of the vehicle.
        width_m: Estimated width.
        std_length_m: Standard deviation of the length.
        std_width_m: Standard deviation of the width.
    """

    track_id: IntArray
    existence: FloatArray
    confirmed: BoolArray
    withdrawn: BoolArray
    hits: IntArray
    detected_s: FloatArray
    age_s: FloatArray
    unseen_s: FloatArray
    missed: FloatArray
    kinds: FloatArray
    ended: FloatArray
    speed_log: FloatArray
    standing_ratio: FloatArray
    stood_log: FloatArray
    born_in_view: FloatArray
    noise_factor: FloatArray
    noise_lon_m: FloatArray
    noise_lat_m: FloatArray
    overlap_with: IntArray
    overlap_s: FloatArray
    length_m: FloatArray
    width_m: FloatArray
    std_length_m: FloatArray
    std_width_m: FloatArray

    def __len__(self) -> int:
        return len(self.track_id)

    @property
    def vehicle(self) -> FloatArray:
        """Probability that each is a vehicle, shape (m,)."""
        return self.existence * vehicle_share(self.kinds)

    def after_scan(self, was_hit: BoolArray, dt_s: float) -> Components:
        """Return the components with a scan's hits, shape (m,), and the time unseen counted."""
        return replace(
            self,
            hits=self.hits + was_hit,
            detected_s=self.detected_s + dt_s * was_hit,
            unseen_s=np.where(was_hit, 0.0, self.unseen_s + dt_s),
        )

    @classmethod
    def newborn(
        cls,
        track_id: IntArray,
        existence: FloatArray,
        vehicle: Footprint = MEAN_CAR,
        kinds: FloatArray | None = None,
    ) -> Components:
        """Return components of their first scan, one detection each.

        Args:
            track_id: Their identities, shape (m,).
            existence: Their existence probabilities, shape (m,).
            vehicle: Their sizes as far as is known before any is measured.
            kinds: Probabilities of the kinds of source, shape (m, 3, 3, levels); certain vehicles if None.
        """
        zeros = np.zeros(len(track_id), dtype=np.int64)
        kinds = certain_vehicles(len(track_id)) if kinds is None else kinds
        return cls(
            track_id=track_id,
            existence=existence,
            confirmed=np.zeros(len(track_id), dtype=np.bool_),
            withdrawn=np.zeros(len(track_id), dtype=np.bool_),
            hits=zeros + 1,
            detected_s=np.zeros(len(track_id)),
            age_s=np.zeros(len(track_id)),
            unseen_s=np.zeros(len(track_id)),
            missed=np.zeros(len(track_id)),
            kinds=kinds,
            ended=np.zeros((len(track_id), KINDS - 1, LEVELS)),
            speed_log=np.zeros((len(track_id), KINDS)),
            noise_factor=np.ones(len(track_id)),
            noise_lon_m=np.zeros(len(track_id)),
            noise_lat_m=np.zeros(len(track_id)),
            standing_ratio=np.ones(len(track_id)),
            stood_log=np.zeros(len(track_id)),
            born_in_view=np.zeros(len(track_id)),
            overlap_with=zeros + NEVER,
            overlap_s=np.zeros(len(track_id)),
            length_m=np.full(len(track_id), vehicle.length_m),
            width_m=np.full(len(track_id), vehicle.width_m),
            std_length_m=np.full(len(track_id), vehicle.std_length_m),
            std_width_m=np.full(len(track_id), vehicle.std_width_m),
        )


@dataclass(frozen=True)
class Mixture:
    """The filter's whole belief: equation (8) with its book-keeping.

    Attributes:
        cloud: The particles.
        components: What is kept of each component.
        next_track_id: The identity that the next new component gets.
        has_headings: Whether the last row of the latents is each particle's direction, as on a lane graph.
    """

    cloud: ParticleCloud
    components: Components
    next_track_id: int = 1
    has_headings: bool = False

    def __len__(self) -> int:
        return len(self.components)

    @property
    def starts(self) -> IntArray:
        """Where each component's particles begin, and the end of the last, shape (m + 1,)."""
        return self.cloud.starts(len(self.components))

    @classmethod
    def empty(cls, latent_size: int, has_headings: bool = False) -> Mixture:
        """Return a belief without components."""
        none, no_index = np.zeros(0), np.zeros(0, dtype=np.int64)
        cloud = ParticleCloud(np.zeros((STATE_SIZE, 0)), none, none, no_index, none, np.zeros((latent_size, 0)))
        return cls(cloud, Components.newborn(no_index, none), has_headings=has_headings)

    def keep(self, keep: BoolArray) -> Self:
        """Return the belief with only the components where ``keep`` is true, shape (m,)."""
        if keep.all():
            return self
        return replace(self, cloud=self._kept_cloud(keep), components=taken(self.components, keep))

    def keep_and_join(self, keep: BoolArray, cloud: ParticleCloud, components: Components) -> Self:
        """Return the belief with the components to keep and further ones behind them.

        Args:
            keep: Which components stay, shape (m,).
            cloud: Particles of the k further ones, which it counts from zero.
            components: The further ones, k of them.
        """
        return replace(
            self,
            cloud=self._kept_cloud(keep, cloud),
            components=joined(taken(self.components, keep), components),
            next_track_id=max(self.next_track_id, int(components.track_id.max(initial=0)) + 1),
        )

    def _kept_cloud(self, keep: BoolArray, then: ParticleCloud | None = None) -> ParticleCloud:
        starts, kept = self.starts, int(keep.sum())
        edges = np.flatnonzero(np.diff(np.concatenate([[False], keep, [False]])))
        stretches = [slice(starts[first], starts[end]) for first, end in edges.reshape(-1, 2)]
        component = np.repeat(np.arange(kept), np.diff(starts)[keep])
        if then is not None:
            component = np.concatenate([component, kept + then.component])
        return self.cloud.stretches(stretches, component, then)
