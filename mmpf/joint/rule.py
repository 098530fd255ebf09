"""The joint update: marginal association probabilities of all components and detections weigh every particle.

Still without an explicit association, but a detection is shared out instead of serving everyone, "not seen" is
evidence that depends on what the tracks hide, and each component has an existence probability. Follows Meyer et al.
(Proc. IEEE 2018) and Reuter et al. (IEEE TSP 2014); keeps the stages of the paper's Fig. 1.
"""

from dataclasses import replace

import numpy as np

from mmpf.belief.birth import FIRST_EXISTENCE, Births, give_birth, lies_on_ego
from mmpf.belief.mixture import Mixture, is_longer
from mmpf.belief.moments import Moments, component_moments, effective_sizes
from mmpf.belief.resampling import resample_smoothly
from mmpf.belief.sizes import with_measured_sizes
from mmpf.joint.association import Marginals, associate, mean_entropy
from mmpf.joint.confirmation import is_improbable, least_probabilities, stands_on_another, still_confirmed, to_confirm
from mmpf.joint.evidence import (
    association_evidence,
    clutter_densities,
    gated_likelihoods,
    log_normalised,
    normalised,
    particle_factors,
)
from mmpf.joint.false_objects import FalseObjects
from mmpf.joint.identity import hand_over_identity
from mmpf.joint.interaction import room_beside_seen_vehicles
from mmpf.joint.kinds_after import ended_meanwhile, kinds_after
from mmpf.joint.known import Known, with_sources
from mmpf.joint.merging import merge_lasting_overlaps
from mmpf.joint.mistaken import mistaken_after, retaken
from mmpf.joint.newborn import Appearances, appearances_at, newborn_sources
from mmpf.joint.noise import common_factor, no_more_exact, with_innovations
from mmpf.joint.range_learning import reach_after
from mmpf.joint.removal import worth_keeping
from mmpf.joint.seeing import occlusion_of, sightings_of
from mmpf.joint.sources import Sources, sources_of
from mmpf.motion.manoeuvring import Manoeuvring
from mmpf.motion.protocol import MotionModel, spreads_speed
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import BoolArray, FloatArray, taken
from mmpf.options.filter import OTHER_SPEED_ERROR, FilterOptions, ModelErrorOptions
from mmpf.scan import Scan, SensorModel
from mmpf.stages.update_rule import Finetuned, MixtureChange, Occlusion, Situation, Updated
from mmpf.visibility.missed_runs import run_after_scan
from mmpf.visibility.range_profile import Reach

YOUNG_EFFECTIVE_SHARE = 0.9
"""Replaces ``effective_share`` for a component with little detected time."""


class JointUpdate:
    """Update rule ``joint``; see ``mmpf.stages.update_rule.UpdateRule``.

    Attributes:
        options: The filter's settings.
        joint: Those of them that only this rule reads.
        known: What was learned up to the last scan; a scan is judged by what was known before it.
    """

    def __init__(self, options: FilterOptions, sensor: SensorModel) -> None:
        """Start with the data sheet."""
        self.options, self.joint = options, options.joint
        self.known = Known.of_data_sheet(sensor)

    @property
    def reach(self) -> Reach:
        """How well the sensor sees at each distance."""
        return self.known.reach

    def motion(self, model: MotionModel) -> MotionModel:
        """Let particles try manoeuvres that the model does not predict."""
        manoeuvres = self.joint.manoeuvres
        return Manoeuvring(model, **manoeuvres.model_dump()) if manoeuvres.begin_per_s else model

    def model_error(self, model: MotionModel) -> ModelErrorOptions:
        """Add no noise to a speed that the model spreads itself, because resampling smooths particles."""
        return self.options.model_error.with_speed(0.0 if spreads_speed(model) else OTHER_SPEED_ERROR)

    def prepare(self, scan: Scan) -> Scan:
        """Bound each detection's accuracy by that of a vehicle's centre."""
        return no_more_exact(scan)

    def first(self, count: int) -> Sources:
        """Return components of the first scan: nothing was observed before."""
        existence = np.full(count, FIRST_EXISTENCE)
        places, known = Appearances.unwatched(count), self.known
        return newborn_sources(1 + np.arange(count), existence, places, known.false_objects, known.sensor, self.options)

    def assert_occlusion(self, prior: Mixture, moments: Moments, situation: Situation) -> Occlusion:
        """Work out each particle's detection probability from the shadows of the other components."""
        return occlusion_of(prior, moments, self.known, situation, self.joint)

    def measurement_update(
        self,
        prior: Mixture,
        moments: Moments,
        occlusion: Occlusion,
        situation: Situation,
        rng: np.random.Generator,
    ) -> Updated:
        """Weigh particles and existence by the association marginals, then resample."""
        options, known, detections = self.joint.association, self.known, situation.scan.detections
        before = sources_of(prior)
        likelihoods = gated_likelihoods(prior, moments, detections, options.gate_std)
        alive, ended = ended_meanwhile(before, known.false_objects, situation.dt_s, self.joint)
        existence = alive.sum(axis=(1, 2, 3))
        starts = prior.starts
        prior_weight = normalised(prior.cloud.log_raw_weight, starts)

        evidence, not_seen = association_evidence(
            prior_weight,
            starts,
            occlusion.detection_probability,
            likelihoods,
            len(detections),
        )
        clutter_density = clutter_densities(detections, known.sensor)
        evidence *= existence[:, None] / clutter_density
        missed = 1.0 - existence + existence * not_seen
        marginals = associate(evidence, missed, options.birth_density, options.exclusive)

        lasting = occlusion.lasting_probability
        outside = (1.0 - lasting) / np.maximum(1.0 - occlusion.run_probability, 1e-12)
        factor = particle_factors(
            occlusion.detection_probability * np.repeat(outside, np.diff(starts)),
            starts,
            likelihoods,
            marginals.detection_message / clutter_density,
        )
        factor *= room_beside_seen_vehicles(
            prior,
            moments,
            before.unseen_s <= self.options.reporting.hidden_after_s,
            situation.plane,
            options.exclusion_per_s * situation.dt_s,
        )
        factor *= prior_weight
        raw = np.log(np.maximum(factor, 1e-300, out=factor), out=factor)
        log_weight = log_normalised(raw, starts)
        cloud = replace(prior.cloud, log_weight=log_weight, log_raw_weight=raw)

        claimed = (evidence * marginals.detection_message).sum(axis=1) / np.maximum(existence, 1e-300)
        run = run_after_scan(occlusion.run_probability, not_seen, claimed)
        lasting = run_after_scan(lasting, 1.0 - outside * (1.0 - not_seen), outside * claimed)
        hit_probability = marginals.probability.sum(axis=1)
        was_hit = hit_probability > options.hit_probability
        sightings = sightings_of(
            prior, moments, occlusion, not_seen, claimed, hit_probability, known, situation, self.joint
        )
        log_odds = (marginals.probability * np.log(detections.odds)).sum(axis=1) / np.maximum(hit_probability, 1e-12)
        sources = before.after_scan(was_hit, situation.dt_s, log_odds).having(missed=run, unexplained=lasting)
        sources = kinds_after(
            sources, before, alive, ended, moments, sightings, known.false_objects, situation, self.options
        )
        objects = self.joint.false_objects
        headings = moments.heading_rad
        sources = mistaken_after(sources, before, sightings, known.false_objects, objects, headings, situation.dt_s)
        reach = None
        if self.joint.reach.learned:
            distance_m = situation.plane.distance_m(moments.mean[LON], moments.mean[LAT])
            reach = reach_after(sightings, before, run, distance_m, known, situation.dt_s, self.joint)
        sources = self._learned_from_hits(sources, before, moments, marginals, was_hit, situation)
        weighed = replace(prior, cloud=cloud, components=sources)
        posterior, weight, effective_share = self._resample(weighed, was_hit, rng)
        return Updated(
            mixture=posterior,
            birth_claim=marginals.unexplained,
            association_entropy=mean_entropy(marginals.probability),
            effective_share=effective_share,
            # Detections that may serve several vehicles can be explained more than once.
            false_detections=max(float(len(detections) - marginals.probability.sum()), 0.0),
            reach=reach,
            weight=weight,
        )

    def remove_add_merge(self, updated: Updated, situation: Situation, rng: np.random.Generator) -> MixtureChange:
        """Remove by evidence, merge lasting overlaps, and start components from unexplained detections."""
        joint, known, dt_s = self.joint, self.known, situation.dt_s
        hidden_after_s = self.options.reporting.hidden_after_s
        moments, sources = component_moments(updated.mixture, updated.weight), sources_of(updated.mixture)
        alive = worth_keeping(sources, moments, situation, joint.removal)
        mixture, keep = merge_lasting_overlaps(updated.mixture, moments, alive, joint.merging, hidden_after_s, dt_s)
        learned = with_sources(known.false_objects.after(dt_s, joint.false_objects.memory_s), sources, ~alive)

        chosen = np.flatnonzero(updated.birth_claim > joint.association.birth_unexplained)
        chosen = chosen[~lies_on_ego(situation.scan.detections, situation.plane)[chosen]]
        density = joint.association.birth_density
        existence = density / (1.0 + density) * updated.birth_claim[chosen]
        places = appearances_at(chosen, updated.mixture, moments, known, situation, self.options)
        newborn = newborn_sources(
            mixture.new_track_ids(len(chosen)), existence, places, learned, known.sensor, self.options
        )
        newborn = newborn.having(noise_factor=np.full(len(chosen), common_factor(sources)))
        births = Births(situation.scan.detections, chosen, newborn, situation.traffic)
        mixture = give_birth(mixture, keep, births, situation.motion, self.options, rng)

        self._learn(updated, learned, dt_s)
        added = component_moments(mixture, since=int(keep.sum()))
        merged = int((alive & ~keep).sum())
        return MixtureChange(mixture, moments.take(keep).followed_by(added), int((~alive).sum()), len(chosen), merged)

    def finetune(
        self,
        mixture: Mixture,
        moments: Moments,
        situation: Situation,
        rng: np.random.Generator,  # noqa: ARG002
    ) -> Finetuned:
        """Confirm components; one confirmed near a hidden component takes over that component's identity."""
        joint, sources = self.joint, sources_of(mixture)
        if len(sources) == 0:
            return Finetuned(mixture, moments=moments)
        least, least_kept = least_probabilities(sources, moments, situation.plane, joint)
        confirmed_now, improbable = to_confirm(sources, least, joint), is_improbable(sources, least_kept, joint)
        stays = still_confirmed(sources, improbable, joint)
        withdrawn = sources.withdrawn | (sources.confirmed & ~stays)
        sources = sources.having(confirmed=stays, withdrawn=withdrawn, improbable=improbable)
        if confirmed_now.any():
            confirmed_now &= ~stands_on_another(sources, moments)
            confirmed, withdrawn = stays | confirmed_now, withdrawn & ~confirmed_now
            sources = sources.having(confirmed=confirmed, withdrawn=withdrawn)
        mixture = replace(mixture, components=sources)
        if not joint.identity.stitch:
            return Finetuned(mixture, moments=moments)
        return hand_over_identity(mixture, moments, confirmed_now, joint.identity, situation.dt_s)

    def weight_update(self, mixture: Mixture) -> Mixture:
        """Make component weights proportional to existence: each expects as many vehicles."""
        existence = mixture.components.existence
        log_weight = np.log(existence / max(existence.sum(), 1e-300))
        cloud = replace(mixture.cloud, log_component_weight=np.repeat(log_weight, np.diff(mixture.starts)))
        return replace(mixture, cloud=cloud)

    def _learned_from_hits(
        self,
        sources: Sources,
        before: Sources,
        moments: Moments,
        marginals: Marginals,
        was_hit: BoolArray,
        situation: Situation,
    ) -> Sources:
        """Learn noise and sizes from the detections, and doubt those of a vehicle that was hidden."""
        hit, sizes = np.flatnonzero(was_hit), situation.scan.detections.sizes
        if len(hit) == 0:
            return sources
        by = marginals.probability[hit].argmax(axis=1)
        was_hidden = before.confirmed & (before.unseen_s > self.options.reporting.hidden_after_s)
        sources = retaken(sources, hit[was_hidden[hit]], marginals, moments, situation.scan.detections)
        if self.joint.noise.learned:
            sources = with_innovations(sources, moments, hit, by, situation)
        return sources if sizes is None else with_measured_sizes(sources, hit, taken(sizes, by))

    def _resample(
        self, posterior: Mixture, was_hit: BoolArray, rng: np.random.Generator
    ) -> tuple[Mixture, FloatArray, float]:
        particles, options = self.options.particles, self.joint.resampling
        weight = np.exp(posterior.cloud.log_weight)
        if len(posterior) == 0:
            return posterior, weight, 1.0
        effective_size = effective_sizes(posterior, weight)
        young = was_hit & ~is_longer(sources_of(posterior).detected_s, options.young_s)
        resampled = effective_size < np.where(young, YOUNG_EFFECTIVE_SHARE, options.effective_share) * particles
        kernel_width = np.where(young, 1.0, options.kernel_width)
        posterior = resample_smoothly(posterior, resampled, particles, kernel_width, rng, weight)
        return posterior, weight, float(effective_size.mean() / particles)

    def _learn(self, updated: Updated, learned: FalseObjects, dt_s: float) -> None:
        """Learn about sensor and sources from the scan, for the next scan on."""
        known = replace(self.known, reach=updated.reach or self.known.reach, false_objects=learned)
        if updated.false_detections is not None:
            known = known.with_clutter(updated.false_detections, dt_s, self.joint.association.clutter_memory_s)
        self.known = known
