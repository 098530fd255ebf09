"""The joint update: soft association marginals of all components and detections weigh every particle.

Still without an explicit association, but a detection is shared out instead of serving everyone, "not seen" is
evidence that depends on what the tracks hide, and each component has an existence probability. Follows Meyer et al.
(Proc. IEEE 2018) and Reuter et al. (IEEE TSP 2014); keeps the stages of the paper's Fig. 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mmpf.around.shadows import Bodies, depth_table, visible_fractions
from mmpf.cloud.birth import give_birth
from mmpf.cloud.mixture import Components, Mixture
from mmpf.cloud.moments import Moments, component_moments, effective_sizes
from mmpf.cloud.resampling import resample_smoothly
from mmpf.cloud.sizes import with_measured_sizes
from mmpf.compute.arrays import FloatArray, IntArray
from mmpf.joint.association import associate
from mmpf.joint.detectability import detection_probabilities, distances_m, missed_probabilities
from mmpf.joint.evidence import (
    association_evidence,
    gated_likelihoods,
    log_normalised,
    normalised,
    particle_factors,
    totals,
)
from mmpf.joint.identity import hand_over_identity
from mmpf.joint.interaction import room_beside_seen_vehicles
from mmpf.joint.merging import merge_lasting_overlaps
from mmpf.options import FilterOptions
from mmpf.state import LAT, LON
from mmpf.update import MixtureChange, Occlusion, Situation, Updated, outside_observation_area

NOMINAL_SCAN_S = 0.1
HIDDEN_PROBABILITY_LIMIT = 0.3
RESAMPLE_YOUNG_BELOW = 0.9
HIT_PROBABILITY = 0.5
SAME_PLACE = 0.75
WELL_PLACED_M = 1.0


@dataclass(frozen=True)
class JointUpdate:
    """Update rule ``joint``; see ``mmpf.update.UpdateRule``.

    Attributes:
        options: The filter's settings.
    """

    options: FilterOptions

    def assert_occlusion(self, prior: Mixture, moments: Moments, situation: Situation) -> Occlusion:
        """Work out each particle's detection probability from the shadows of the other components."""
        joint, ego = self.options.joint, situation.scan.ego
        cloud = prior.cloud
        if joint.shadow:
            casts = prior.components.existence > joint.occluder_existence
            bodies = Bodies(prior.components.length_m, prior.components.width_m)
            table = depth_table(ego, moments.mean[LON], moments.mean[LAT], casts, bodies)
            visible = visible_fractions(ego, cloud.state[LON], cloud.state[LAT], cloud.component, bodies, table)
            distance = distances_m(ego, cloud.state[LON], cloud.state[LAT])
            probability = detection_probabilities(
                visible, distance, situation.sensor, joint.hidden_detection_probability
            )
            missed = missed_probabilities(
                visible,
                probability,
                joint.missed_detection_cap,
                joint.missed_from_fraction,
                joint.missed_full_fraction,
            )
        else:
            probability = np.full(len(cloud), joint.fixed_probability)
            missed = np.minimum(probability, joint.missed_detection_cap)
        weight = np.exp(cloud.log_weight)
        weight *= probability
        expected = totals(weight, prior.starts)
        return Occlusion(probability, missed, expected < HIDDEN_PROBABILITY_LIMIT)

    def measurement_update(
        self,
        prior: Mixture,
        moments: Moments,
        occlusion: Occlusion,
        situation: Situation,
        rng: np.random.Generator,
    ) -> Updated:
        """Weigh particles and existence by the association marginals, then resample."""
        joint, detections = self.options.joint, situation.scan.detections
        likelihoods = gated_likelihoods(prior, moments, detections, joint.gate_std)
        survival = joint.survival_probability ** (situation.dt_s / NOMINAL_SCAN_S)
        existence = prior.components.existence * survival
        prior_weight = normalised(prior.cloud.log_raw_weight, prior.starts)

        evidence, not_seen = association_evidence(
            prior_weight,
            prior.starts,
            occlusion.detection_probability,
            occlusion.missed_probability,
            likelihoods,
            len(detections),
        )
        evidence *= existence[:, None] / situation.sensor.clutter_density_per_m2
        missed = 1.0 - existence + existence * not_seen
        marginals = associate(evidence, missed, joint.birth_density, joint.exclusive)

        factor = particle_factors(
            occlusion.detection_probability,
            occlusion.missed_probability,
            prior.starts,
            likelihoods,
            marginals.detection_message / situation.sensor.clutter_density_per_m2,
        )
        factor *= room_beside_seen_vehicles(
            prior,
            moments,
            prior.components.unseen_s <= self.options.reporting.hidden_after_s,
            situation.scan.ego,
            joint.exclusion_strength * situation.dt_s / NOMINAL_SCAN_S,
        )
        claimed = (evidence * marginals.detection_message).sum(axis=1)
        existence = np.minimum((existence * not_seen + claimed) / (missed + claimed), 0.99)

        was_hit = marginals.probability.sum(axis=1) > HIT_PROBABILITY
        components = _count_hits(prior.components, was_hit, existence, situation.dt_s)
        hit = np.flatnonzero(was_hit)
        if detections.sizes is not None and len(hit):
            measured = detections.sizes.take(marginals.probability[hit].argmax(axis=1))
            components = with_measured_sizes(components, hit, measured)
        raw = np.log(np.maximum(prior_weight * factor, 1e-300))
        log_weight = log_normalised(raw, prior.starts)
        cloud = replace(prior.cloud, log_weight=log_weight, log_raw_weight=raw)
        posterior = replace(prior, cloud=cloud, components=components)
        posterior, effective_share = self._resample(posterior, was_hit, rng)
        return Updated(
            mixture=posterior,
            was_hit=was_hit,
            birth_claim=marginals.unexplained,
            association_entropy=_mean_entropy(marginals.probability),
            effective_share=effective_share,
        )

    def remove_add_merge(self, updated: Updated, situation: Situation, rng: np.random.Generator) -> MixtureChange:
        """Remove by evidence, merge lasting overlaps, and start components from unexplained detections."""
        joint, moments = self.options.joint, component_moments(updated.mixture)
        alive = self._worth_keeping(updated.mixture.components, moments, situation)
        mixture, keep = merge_lasting_overlaps(
            updated.mixture,
            moments,
            alive,
            joint.merge_lon_m,
            joint.merge_lat_m,
            joint.merge_scans,
            self.options.reporting.hidden_after_s,
        )
        chosen = np.flatnonzero(updated.birth_claim > joint.birth_unexplained)
        chosen = chosen[~self._on_ego(situation, chosen)]
        existence = joint.birth_density / (1.0 + joint.birth_density) * updated.birth_claim[chosen]
        mixture = give_birth(
            mixture,
            keep,
            situation.scan.detections,
            chosen,
            existence,
            situation.traffic,
            situation.motion,
            self.options.particles,
            self.options.birth,
            self.options.vehicle,
            rng,
        )
        return MixtureChange(mixture, removed=int((~alive).sum()), added=len(chosen), merged=int((alive & ~keep).sum()))

    def finetune(
        self,
        mixture: Mixture,
        situation: Situation,
        rng: np.random.Generator,  # noqa: ARG002
    ) -> tuple[Mixture, int]:
        """Confirm components; one that is confirmed near a hidden component is that component, seen again."""
        joint, components = self.options.joint, mixture.components
        confirmed_now = (
            ~components.confirmed
            & (components.existence > joint.confirm_existence)
            & (components.hits >= joint.confirm_hits)
        )
        if not confirmed_now.any():
            return mixture, 0
        moments = component_moments(mixture)
        confirmed_now &= ~_stands_on_another(components, moments)
        components = replace(components, confirmed=components.confirmed | confirmed_now)
        mixture = replace(mixture, components=components)
        if not joint.stitch:
            return mixture, 0
        return hand_over_identity(mixture, moments, confirmed_now, joint, situation.dt_s)

    def weight_update(self, mixture: Mixture) -> Mixture:
        """Make component weights proportional to existence: each expects as many vehicles."""
        existence = mixture.components.existence
        log_weight = np.log(existence / max(existence.sum(), 1e-300))
        cloud = replace(mixture.cloud, log_component_weight=log_weight[mixture.cloud.component])
        return replace(mixture, cloud=cloud)

    def _resample(
        self, posterior: Mixture, was_hit: npt.NDArray[np.bool_], rng: np.random.Generator
    ) -> tuple[Mixture, float]:
        particles, joint = self.options.particles, self.options.joint
        if len(posterior) == 0:
            return posterior, 1.0
        effective_size = effective_sizes(posterior)
        young = was_hit & (posterior.components.hits <= joint.young_hits)
        resampled = effective_size < np.where(young, RESAMPLE_YOUNG_BELOW, joint.resample_below) * particles
        kernel_width = np.where(young, 1.0, joint.kernel_width)
        posterior = resample_smoothly(posterior, resampled, particles, kernel_width, rng)
        return posterior, float(effective_size.mean() / particles)

    def _worth_keeping(self, components: Components, moments: Moments, situation: Situation) -> npt.NDArray[np.bool_]:
        joint = self.options.joint
        left = outside_observation_area(
            moments.mean[LON], moments.mean[LAT], situation.scan.ego, situation.sensor, joint.range_margin_m
        )
        patience_s = np.where(components.confirmed, joint.longest_unseen_s, joint.unconfirmed_unseen_s)
        return np.asarray(
            (components.existence >= joint.prune_existence)
            & (components.unseen_s <= patience_s)
            & (moments.std[LON] <= joint.largest_std_lon_m)
            & ~left
        )

    def _on_ego(self, situation: Situation, chosen: IntArray) -> npt.NDArray[np.bool_]:
        ego, detections = situation.scan.ego, situation.scan.detections
        return np.asarray(
            (np.abs(detections.lon_m[chosen] - ego.lon_m) < 0.5 * ego.length_m)
            & (np.abs(detections.lat_m[chosen] - ego.lat_m) < 0.5 * ego.width_m)
        )


def _stands_on_another(components: Components, moments: Moments) -> npt.NDArray[np.bool_]:
    """Return which components share a footprint with a confirmed, well placed one: they may not be confirmed."""
    mean = moments.mean
    blocks = components.confirmed & (moments.std[LON] < WELL_PLACED_M)
    length, width = components.length_m, components.width_m
    overlaps = np.abs(mean[LON][:, None] - mean[LON]) < SAME_PLACE * 0.5 * (length[:, None] + length)
    overlaps &= np.abs(mean[LAT][:, None] - mean[LAT]) < SAME_PLACE * 0.5 * (width[:, None] + width)
    np.fill_diagonal(overlaps, val=False)
    return np.asarray((overlaps & blocks[None, :]).any(axis=1))


def _count_hits(
    components: Components, was_hit: npt.NDArray[np.bool_], existence: FloatArray, dt_s: float
) -> Components:
    return replace(
        components,
        existence=existence,
        hits=components.hits + was_hit,
        unseen_s=np.where(was_hit, 0.0, components.unseen_s + dt_s),
    )


def _mean_entropy(probability: FloatArray) -> float:
    if probability.size == 0:
        return 0.0
    full = np.column_stack([probability, np.maximum(1.0 - probability.sum(axis=1), 0.0)])
    return float(-(full * np.log(np.maximum(full, 1e-300))).sum(axis=1).mean())
