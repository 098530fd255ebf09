"""The joint update: soft association marginals of all components and detections weigh every particle.

Still without an explicit association, but a detection is shared out instead of serving everyone, "not seen" is
evidence that depends on what the tracks hide, and each component has an existence probability. Follows Meyer et al.
(Proc. IEEE 2018) and Reuter et al. (IEEE TSP 2014); keeps the stages of the paper's Fig. 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mmpf.belief.birth import Births, give_birth, lies_on_ego
from mmpf.belief.kinds import Sightings, mean_detectability
from mmpf.belief.mixture import Components, Mixture, is_longer
from mmpf.belief.moments import Moments, component_moments, effective_sizes
from mmpf.belief.resampling import resample_smoothly
from mmpf.belief.sizes import with_measured_sizes
from mmpf.joint.association import Marginals, associate
from mmpf.joint.confirmation import lies_in_path, stands_on_another, still_confirmed, to_confirm
from mmpf.joint.evidence import (
    association_evidence,
    gated_likelihoods,
    log_normalised,
    normalised,
    particle_factors,
)
from mmpf.joint.identity import hand_over_identity
from mmpf.joint.interaction import room_beside_seen_vehicles
from mmpf.joint.kinds_after import ended_meanwhile, kinds_after
from mmpf.joint.merging import merge_lasting_overlaps
from mmpf.joint.newborn import appearances_at, kinds_at_birth
from mmpf.joint.noise import common_factor, with_innovations
from mmpf.joint.range_learning import reach_after
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import BoolArray, FloatArray
from mmpf.options.filter import FilterOptions
from mmpf.scan import Detections, SensorModel
from mmpf.stages.update_rule import MixtureChange, Occlusion, Situation, Updated, outside_observation_area
from mmpf.visibility.depth import Bodies, depth_table
from mmpf.visibility.detection_probability import detection_probabilities, in_plain_view
from mmpf.visibility.false_objects import FalseObjects
from mmpf.visibility.field import half_widths, share_in_field, worth_at_edge
from mmpf.visibility.missed_runs import run_after_scan, run_expected
from mmpf.visibility.range_profile import share_at
from mmpf.visibility.shadows import visible_fractions

# A single detection is no object that stays.
FEWEST_FALSE_HITS = 2


@dataclass(frozen=True)
class JointUpdate:
    """Update rule ``joint``; see ``mmpf.stages.update_rule.UpdateRule``.

    Attributes:
        options: The filter's settings.
    """

    options: FilterOptions

    def assert_occlusion(self, prior: Mixture, moments: Moments, situation: Situation) -> Occlusion:
        """Work out each particle's detection probability from the shadows of the other components."""
        options, plane, cloud = self.options.joint.detectability, situation.plane, prior.cloud
        if options.shadow:
            casts = prior.components.vehicle > options.occluder_existence
            bodies = Bodies(prior.components.length_m, prior.components.width_m, moments.direction_rad)
            table = depth_table(plane, moments.mean[LON], moments.mean[LAT], casts, bodies)
            visible = visible_fractions(plane, cloud.state[LON], cloud.state[LAT], cloud.component, bodies, table)
            half_width = half_widths(prior.components)[cloud.component]
            free_space = situation.scan.free_space
            in_field = share_in_field(plane, cloud.state[LON], cloud.state[LAT], half_width, free_space)
            visible = visible if in_field is None else np.minimum(visible, in_field)
            distance = plane.distance_m(cloud.state[LON], cloud.state[LAT])
            shares = situation.reach.shares(self.options.joint.reach.prior_scans)
            probability = detection_probabilities(
                visible, distance, situation.sensor, shares, options.hidden_probability
            )
        else:
            probability = np.full(len(cloud), options.fixed_probability)
        run = run_expected(prior.components.missed, options.run_share, options.run_s, situation.dt_s)
        seen = (1.0 - run) * mean_detectability(prior.components.kinds)
        return Occlusion(probability * seen[cloud.component], run)

    def measurement_update(
        self,
        prior: Mixture,
        moments: Moments,
        occlusion: Occlusion,
        situation: Situation,
        rng: np.random.Generator,
    ) -> Updated:
        """Weigh particles and existence by the association marginals, then resample."""
        options, detections = self.options.joint.association, situation.scan.detections
        likelihoods = gated_likelihoods(prior, moments, detections, options.gate_std)
        alive, ended = ended_meanwhile(prior.components, situation, self.options.joint)
        existence = alive.sum(axis=(1, 2, 3))
        prior_weight = normalised(prior.cloud.log_raw_weight, prior.starts)

        evidence, not_seen = association_evidence(
            prior_weight,
            prior.starts,
            occlusion.detection_probability,
            likelihoods,
            len(detections),
        )
        clutter_density = _clutter_densities(detections, situation.sensor)
        evidence *= existence[:, None] / clutter_density
        missed = 1.0 - existence + existence * not_seen
        marginals = associate(evidence, missed, options.birth_density, options.exclusive)

        factor = particle_factors(
            occlusion.detection_probability,
            prior.starts,
            likelihoods,
            marginals.detection_message / clutter_density,
        )
        factor *= room_beside_seen_vehicles(
            prior,
            moments,
            prior.components.unseen_s <= self.options.reporting.hidden_after_s,
            situation.plane,
            options.exclusion_per_s * situation.dt_s,
        )
        claimed = (evidence * marginals.detection_message).sum(axis=1) / np.maximum(existence, 1e-300)
        run = run_after_scan(occlusion.run_probability, not_seen, claimed)
        hit_probability = marginals.probability.sum(axis=1)
        was_hit = hit_probability > options.hit_probability
        sightings = self._sightings(prior, moments, occlusion, not_seen, claimed, hit_probability, situation)
        components = replace(prior.components.after_scan(was_hit, situation.dt_s), missed=run)
        components = kinds_after(
            components, prior.components, alive, ended, moments, sightings, situation, self.options
        )
        reach = situation.reach
        if self.options.joint.reach.learned:
            distance_m = situation.plane.distance_m(moments.mean[LON], moments.mean[LAT])
            reach = reach_after(sightings, prior.components, run, distance_m, situation, self.options.joint)
        components = self._learned_from_hits(components, moments, marginals, was_hit, situation)
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
            # Detections that may serve several vehicles can be explained more than once.
            false_detections=max(float(len(detections) - marginals.probability.sum()), 0.0),
            reach=reach,
        )

    def remove_add_merge(self, updated: Updated, situation: Situation, rng: np.random.Generator) -> MixtureChange:
        """Remove by evidence, merge lasting overlaps, and start components from unexplained detections."""
        association = self.options.joint.association
        moments = component_moments(updated.mixture)
        alive = self._worth_keeping(updated.mixture.components, moments, situation)
        hidden_after_s, merging = self.options.reporting.hidden_after_s, self.options.joint.merging
        mixture, keep = merge_lasting_overlaps(updated.mixture, moments, alive, merging, hidden_after_s, situation.dt_s)
        chosen = np.flatnonzero(updated.birth_claim > association.birth_unexplained)
        chosen = chosen[~lies_on_ego(situation.scan.detections, situation.plane)[chosen]]
        density = association.birth_density
        existence = density / (1.0 + density) * updated.birth_claim[chosen]
        joint = self.options.joint
        learned = situation.false_objects.after(situation.dt_s, joint.false_objects.memory_s)
        learned = _with_removed(learned, updated.mixture.components, ~alive)
        places = appearances_at(chosen, updated.mixture, moments, situation, self.options)
        births = Births(
            situation.scan.detections,
            chosen,
            existence,
            situation.traffic,
            kinds_at_birth(places, learned, situation.sensor, joint),
            common_factor(updated.mixture.components),
            places.standing_ratio(joint.newborn),
            places.in_view,
        )
        mixture = give_birth(mixture, keep, births, situation.motion, self.options, rng)
        merged = int((alive & ~keep).sum())
        return MixtureChange(mixture, int((~alive).sum()), len(chosen), merged, false_objects=learned)

    def finetune(
        self,
        mixture: Mixture,
        situation: Situation,
        rng: np.random.Generator,  # noqa: ARG002
    ) -> tuple[Mixture, int]:
        """Confirm components; one that is confirmed near a hidden component is that component, seen again."""
        joint, components = self.options.joint, mixture.components
        if len(components) == 0:
            return mixture, 0
        moments = component_moments(mixture)
        in_path = lies_in_path(components, moments, situation.plane, joint.path)
        confirmed_now, stays = (judge(components, in_path, joint) for judge in (to_confirm, still_confirmed))
        withdrawn = components.withdrawn | (components.confirmed & ~stays)
        components = replace(components, confirmed=stays, withdrawn=withdrawn)
        mixture = replace(mixture, components=components)
        if not confirmed_now.any():
            return mixture, 0
        confirmed_now &= ~stands_on_another(components, moments, joint.existence)
        components = replace(
            components, confirmed=components.confirmed | confirmed_now, withdrawn=components.withdrawn & ~confirmed_now
        )
        mixture = replace(mixture, components=components)
        if not joint.identity.stitch:
            return mixture, 0
        return hand_over_identity(mixture, moments, confirmed_now, joint.identity, situation.dt_s)

    def weight_update(self, mixture: Mixture) -> Mixture:
        """Make component weights proportional to existence: each expects as many vehicles."""
        existence = mixture.components.existence
        log_weight = np.log(existence / max(existence.sum(), 1e-300))
        cloud = replace(mixture.cloud, log_component_weight=log_weight[mixture.cloud.component])
        return replace(mixture, cloud=cloud)

    def _sightings(
        self,
        prior: Mixture,
        moments: Moments,
        occlusion: Occlusion,
        not_seen: FloatArray,
        claimed: FloatArray,
        hit: FloatArray,
        situation: Situation,
    ) -> Sightings:
        """Return what the sensor would make of a source of full detectability at each component's place."""
        expected = (1.0 - occlusion.run_probability) * mean_detectability(prior.components.kinds)
        distance_m = situation.plane.distance_m(moments.mean[LON], moments.mean[LAT])
        shares = share_at(
            distance_m, situation.reach.shares(self.options.joint.reach.prior_scans), situation.reach.ring_m
        )
        free_space, half_width = situation.scan.free_space, half_widths(prior.components)
        in_field = share_in_field(situation.plane, moments.mean[LON], moments.mean[LAT], half_width, free_space)
        worth = (
            np.ones(len(prior))
            if in_field is None
            else worth_at_edge(in_field, situation.sensor, self.options.joint.detectability.hidden_probability)
        )
        return Sightings(
            in_shadow=(1.0 - not_seen) / np.maximum(expected, 1e-6),
            in_plain_view=in_plain_view(situation.sensor, shares) * worth,
            in_field=worth,
            claimed=claimed / np.maximum(1.0 - not_seen, 1e-12),
            hit=hit,
            run_probability=occlusion.run_probability,
        )

    def _learned_from_hits(
        self, components: Components, moments: Moments, marginals: Marginals, was_hit: BoolArray, situation: Situation
    ) -> Components:
        """Take in what the detections say of noise and sizes."""
        hit, sizes = np.flatnonzero(was_hit), situation.scan.detections.sizes
        if len(hit) == 0:
            return components
        by = marginals.probability[hit].argmax(axis=1)
        if self.options.joint.noise.learned:
            components = with_innovations(components, moments, hit, by, situation, self.options.joint.noise)
        return components if sizes is None else with_measured_sizes(components, hit, sizes.take(by))

    def _resample(self, posterior: Mixture, was_hit: BoolArray, rng: np.random.Generator) -> tuple[Mixture, float]:
        particles, options = self.options.particles, self.options.joint.resampling
        if len(posterior) == 0:
            return posterior, 1.0
        effective_size = effective_sizes(posterior)
        young = was_hit & ~is_longer(posterior.components.detected_s, options.young_s)
        resampled = effective_size < np.where(young, options.young_effective_share, options.effective_share) * particles
        kernel_width = np.where(young, 1.0, options.kernel_width)
        posterior = resample_smoothly(posterior, resampled, particles, kernel_width, rng)
        return posterior, float(effective_size.mean() / particles)

    def _worth_keeping(self, components: Components, moments: Moments, situation: Situation) -> BoolArray:
        removal = self.options.joint.removal
        left = outside_observation_area(moments.mean[LON], moments.mean[LAT], situation, removal.range_margin_m)
        patience_s = np.where(components.confirmed, removal.longest_unseen_s, removal.unconfirmed_unseen_s)
        return np.asarray(
            (components.existence >= removal.existence_below)
            & (components.unseen_s <= patience_s)
            & (moments.std_along_m <= removal.largest_std_lon_m)
            & ~left
        )


def _with_removed(learned: FalseObjects, components: Components, removed: BoolArray) -> FalseObjects:
    """Return what is known of sources, with the vehicles that are there and with all that are removed."""
    alive = components.existence[:, None, None, None] * components.kinds
    learned = learned.with_vehicles(
        alive, components.hits, components.born_in_view, np.exp(components.stood_log), removed
    )
    gone = np.flatnonzero(removed & (components.hits >= FEWEST_FALSE_HITS))
    lived_s = np.maximum(components.age_s[gone] - components.unseen_s[gone], 0.0)
    return learned.with_removed(alive[gone], components.ended[gone], lived_s)


def _clutter_densities(detections: Detections, sensor: SensorModel) -> FloatArray:
    """Return the density of clutter at each detection, per square metre and, where it is measured, m/s, shape (d,)."""
    per_speed = np.where(np.isfinite(detections.speed_mps), 1.0 / sensor.clutter_speed_span_mps, 1.0)
    return np.asarray(sensor.clutter_density_per_m2 * per_speed)


def _mean_entropy(probability: FloatArray) -> float:
    if probability.size == 0:
        return 0.0
    full = np.column_stack([probability, np.maximum(1.0 - probability.sum(axis=1), 0.0)])
    return float(-(full * np.log(np.maximum(full, 1e-300))).sum(axis=1).mean())
