"""The filter's belief: particles and components as struct of arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

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
        """Return the chosen particles under new component indices, weights unchanged.

        Args:
            particles: Indices of the particles to keep, shape (k,).
            component: Their components' new indices, ascending, shape (k,).
        """
        columns = {f.name: getattr(self, f.name).take(particles, axis=-1) for f in fields(self)}
        return ParticleCloud(**(columns | {"component": component}))


def is_longer(time_s: FloatArray, least_s: FloatArray | float) -> BoolArray:
    """Return which times reach a minimum, up to rounding."""
    return np.asarray(time_s > least_s - ROUNDING_S)


@dataclass(frozen=True)
class Components:
    """The state of each component in every rule beside its particles, struct of arrays over m components.

    A rule that keeps more has a class of its own with further columns.

    Attributes:
        track_id: Identity that is reported.
        existence: Probability that there is something that gives detections.
        confirmed: Whether the component is a track.
        improbable: Whether it is probably no vehicle, so that it is not reported although it may be a track.
        hits: Scans in which a detection was attributed to it; ``unseen_s`` is the time since the last.
        age_s: Time since its birth.
        length_m: Estimated length of the vehicle, with its deviation, as of its width.
    """

    track_id: IntArray
    existence: FloatArray
    confirmed: BoolArray
    improbable: BoolArray
    hits: IntArray
    age_s: FloatArray
    unseen_s: FloatArray
    length_m: FloatArray
    width_m: FloatArray
    std_length_m: FloatArray
    std_width_m: FloatArray

    def __len__(self) -> int:
        return len(self.track_id)

    @property
    def vehicle(self) -> FloatArray:
        """Probability that each is a vehicle, shape (m,)."""
        return self.existence * self.vehicle_share

    @property
    def vehicle_share(self) -> FloatArray:
        """Probability that each is a vehicle, given that it exists, shape (m,); 1 unless a rule doubts it."""
        return np.ones(len(self))

    @property
    def noise_m(self) -> tuple[FloatArray, FloatArray]:
        """Deviations of each one's detections, along and across, each of shape (m,); 0 for a rule that learns none."""
        return np.zeros(len(self)), np.zeros(len(self))

    @property
    def elsewhere(self) -> tuple[FloatArray, FloatArray]:
        """Probability that each vehicle is not where its particles are, (m,), and its mean squared offset then, (3, m).

        They are along the frame's axes and in speed; a rule that does not doubt its components says 0.
        """
        return np.zeros(len(self)), np.zeros((3, len(self)))

    def after_scan(self, was_hit: BoolArray, dt_s: float) -> Self:
        """Return the components with a scan's hits, shape (m,), and the time unseen counted."""
        return self.having(hits=self.hits + was_hit, unseen_s=np.where(was_hit, 0.0, self.unseen_s + dt_s))

    def having(self, **columns: FloatArray | IntArray | BoolArray) -> Self:
        """Return the components with other columns; much faster than ``dataclasses.replace``, as they are many."""
        if not columns.keys() <= vars(self).keys():
            raise TypeError(f"components have no column for all of: {', '.join(columns)}")
        other = object.__new__(type(self))
        vars(other).update(vars(self), **columns)
        return other

    @classmethod
    def newborn(cls, track_id: IntArray, existence: FloatArray, vehicle: Footprint = MEAN_CAR) -> Self:
        """Return components of their first scan, one detection each.

        Args:
            track_id: Their identities, shape (m,).
            existence: Their existence probabilities, shape (m,).
            vehicle: Their sizes as far as is known before any is measured.
        """
        zeros = np.zeros(len(track_id), dtype=np.int64)
        return cls(
            track_id=track_id,
            existence=existence,
            confirmed=np.zeros(len(track_id), dtype=np.bool_),
            improbable=np.zeros(len(track_id), dtype=np.bool_),
            hits=zeros + 1,
            age_s=np.zeros(len(track_id)),
            unseen_s=np.zeros(len(track_id)),
            length_m=np.full(len(track_id), vehicle.length_m),
            width_m=np.full(len(track_id), vehicle.width_m),
            std_length_m=np.full(len(track_id), vehicle.std_length_m),
            std_width_m=np.full(len(track_id), vehicle.std_width_m),
        )


@dataclass(frozen=True)
class Mixture:
    """The filter's whole belief: equation (8) with its bookkeeping.

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
    def empty(cls, latent_size: int, nobody: Components, has_headings: bool = False) -> Mixture:
        """Return a belief without components; ``nobody`` says which columns they will have."""
        none, no_index = np.zeros(0), np.zeros(0, dtype=np.int64)
        cloud = ParticleCloud(np.zeros((STATE_SIZE, 0)), none, none, no_index, none, np.zeros((latent_size, 0)))
        return cls(cloud, nobody, has_headings=has_headings)

    def new_track_ids(self, count: int) -> IntArray:
        """Return the identities of the next new components, shape (count,)."""
        return self.next_track_id + np.arange(count)

    def keep(self, keep: BoolArray) -> Self:
        """Return the belief with only the components where ``keep`` is true, shape (m,)."""
        if keep.all():
            return self
        return replace(self, cloud=self._kept_cloud(keep), components=taken(self.components, keep))

    def keep_and_join(self, keep: BoolArray, cloud: ParticleCloud, components: Components) -> Self:
        """Return the belief with the kept components, followed by further ones.

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
        """Return the particles of the kept components, followed by another cloud's, weights unchanged."""
        starts, cloud = self.starts, self.cloud
        edges = np.flatnonzero(np.diff(np.concatenate([[False], keep, [False]])))
        stretches = [slice(0), *(slice(starts[first], starts[end]) for first, end in edges.reshape(-1, 2))]
        sizes = np.diff(starts)[keep]
        if then is not None:
            sizes = np.concatenate([sizes, np.bincount(then.component)])

        def one_after_the_other(name: str) -> FloatArray:
            parts = [getattr(cloud, name)[..., stretch] for stretch in stretches]
            return np.concatenate(parts if then is None else [*parts, getattr(then, name)], axis=-1)

        columns = {f.name: one_after_the_other(f.name) for f in fields(cloud) if f.name != "component"}
        return ParticleCloud(component=np.repeat(np.arange(len(sizes)), sizes), **columns)
