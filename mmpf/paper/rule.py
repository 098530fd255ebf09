"""The paper's update: a particle's likelihood is its largest over all detections, then k-medoids reclustering.

Section II of Li, Zhan and Tomizuka (2018), equations (8) to (11) and the stages of Fig. 1, in log space.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from mmpf.belief.birth import FIRST_EXISTENCE, Births, give_birth, lies_on_ego
from mmpf.belief.mixture import Components, Mixture
from mmpf.belief.moments import Moments, component_moments, effective_sizes, gate_table
from mmpf.belief.resampling import resample
from mmpf.motion.protocol import MotionModel
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.numerics.kernels import kernel
from mmpf.options.filter import FilterOptions, ModelErrorOptions
from mmpf.options.paper import PaperMerging
from mmpf.paper.clustering import recluster, touching, with_component_index
from mmpf.scan import Detections, Scan, SensorModel
from mmpf.stages.update_rule import Finetuned, MixtureChange, Occlusion, Situation, Updated, outside_observation_area
from mmpf.visibility.depth import Occluders, depth_table
from mmpf.visibility.range_profile import Reach
from mmpf.visibility.shadows import shadowed_share, visible_fractions

SHADOWED_SHARE = 0.85
"""A component with at least this share of its extent in shadow counts as completely occluded."""
CONFIRM_HITS = 3
"""Scans with an update before a component is reported."""


@dataclass(frozen=True)
class MaxLikelihoodUpdate:
    """Update rule ``max_likelihood``; see ``mmpf.stages.update_rule.UpdateRule``.

    It learns nothing of the sensor: the data sheet holds.

    Attributes:
        options: The filter's settings.
        sensor: The sensor's data sheet.
    """

    options: FilterOptions
    sensor: SensorModel

    @property
    def reach(self) -> Reach:
        """What the data sheet says."""
        return Reach.of_data_sheet(self.sensor.range_m)

    def motion(self, model: MotionModel) -> MotionModel:
        """Move particles by the model alone."""
        return model

    def model_error(self, model: MotionModel) -> ModelErrorOptions:  # noqa: ARG002
        """Add noise to the model's prediction because resampling copies particles."""
        return self.options.model_error.with_speed()

    def prepare(self, scan: Scan) -> Scan:
        """Return the scan unchanged."""
        return scan

    def first(self, count: int) -> Components:
        """Return components of the first scan."""
        existence = np.full(count, FIRST_EXISTENCE)
        return Components.newborn(1 + np.arange(count), existence, self.options.vehicle)

    def assert_occlusion(self, prior: Mixture, moments: Moments, situation: Situation) -> Occlusion:
        """Use the sensor's statement on which components are completely occluded, or else the tracks' shadows."""
        plane, free_space, mean = situation.plane, situation.scan.free_space, moments.mean
        bodies = Occluders(prior.components.length_m, prior.components.width_m, moments.heading_rad)
        if free_space is not None:
            shadowed = shadowed_share(plane, mean[LON], mean[LAT], bodies, free_space)
        else:
            table = depth_table(plane, mean[LON], mean[LAT], np.ones(len(prior), dtype=np.bool_), bodies)
            shadowed = 1.0 - visible_fractions(plane, mean[LON], mean[LAT], np.arange(len(prior)), bodies, table)
        is_hidden = shadowed >= SHADOWED_SHARE
        probability = np.where(is_hidden, 0.0, 1.0)[prior.cloud.component]
        return Occlusion(probability, *np.zeros((2, len(prior))))

    def measurement_update(
        self,
        prior: Mixture,
        moments: Moments,
        occlusion: Occlusion,
        situation: Situation,
        rng: np.random.Generator,
    ) -> Updated:
        """Weigh each particle by its largest likelihood, equation (10), and components by equation (11)."""
        rule, detections = self.options.max_likelihood, situation.scan.detections
        gate = gate_table(moments, detections, rule.association.gate_std)
        # The assertion holds for components as wholes: the first particle tells of all.
        is_hidden = occlusion.detection_probability[prior.starts[:-1]] == 0.0
        performs_update = ~is_hidden & gate.any(axis=1)
        log_likelihood, chosen = largest_log_likelihood(prior, detections, performs_update)

        log_raw = prior.cloud.log_raw_weight + log_likelihood
        log_sum = _log_sums(log_raw, prior)
        log_weight = log_raw - log_sum[prior.cloud.component]
        log_before = (
            np.full(len(prior), -np.log(max(len(prior), 1)))
            if rule.existence.weights_anew
            else prior.cloud.log_component_weight[prior.starts[:-1]]
        )
        log_component = _component_weights(log_before, log_sum, performs_update, rule.existence.floor_weight)

        was_hit = performs_update & gate_table(moments, detections, rule.association.hit_gate_std).any(axis=1)
        cloud = replace(
            prior.cloud,
            log_weight=log_weight,
            log_raw_weight=log_raw,
            log_component_weight=log_component[prior.cloud.component],
        )
        posterior = replace(prior, cloud=cloud, components=prior.components.after_scan(was_hit, situation.dt_s))
        effective_size = effective_sizes(posterior)
        size = np.diff(posterior.starts)
        depleted = effective_size < rule.resampling.effective_share * size
        depleted |= size > 2 * self.options.particles
        posterior, _ = resample(posterior, depleted, self.options.particles, rng)
        votes = np.bincount(chosen[chosen >= 0], minlength=len(detections)) / self.options.particles
        return Updated(
            mixture=posterior,
            birth_claim=1.0 - np.minimum(votes, 1.0),
            association_entropy=0.0,
            effective_share=float(effective_size.mean() / self.options.particles) if len(prior) else 1.0,
        )

    def remove_add_merge(self, updated: Updated, situation: Situation, rng: np.random.Generator) -> MixtureChange:
        """Remove light or departed components, add one per detection that few particles chose, merge overlaps."""
        rule = self.options.max_likelihood
        keep = self._worth_keeping(updated.mixture, situation)
        detections = situation.scan.detections
        is_wanted = updated.birth_claim > 1.0 - rule.existence.added_particles
        chosen = np.flatnonzero(is_wanted & ~lies_on_ego(detections, situation.plane))
        track_id = updated.mixture.new_track_ids(len(chosen))
        components = Components.newborn(track_id, np.ones(len(chosen)), self.options.vehicle)
        births = Births(detections, chosen, components, situation.traffic)
        mixture = give_birth(updated.mixture, keep, births, situation.motion, self.options, rng)
        mixture, merged = _merge_overlaps(mixture, rule.merging, self.options.reporting.hidden_after_s)
        return MixtureChange(mixture, component_moments(mixture), int((~keep).sum()), len(chosen), merged)

    def finetune(
        self,
        mixture: Mixture,
        moments: Moments,
        situation: Situation,  # noqa: ARG002
        rng: np.random.Generator,
    ) -> Finetuned:
        """Recluster the particles of components that touch by k-medoids, and confirm those old enough."""
        rule, components = self.options.max_likelihood, mixture.components
        touch = rule.reclustering
        confirmed = components.confirmed | (components.hits >= CONFIRM_HITS)
        mixture = replace(mixture, components=replace(components, confirmed=confirmed))
        return Finetuned(*recluster(mixture, moments, touch, rng))

    def weight_update(self, mixture: Mixture) -> Mixture:
        """Recompute pi'_m = sum of pi_c(i) w(i) over the new members, and w within them."""
        return renormalised(mixture)

    def _worth_keeping(self, mixture: Mixture, situation: Situation) -> BoolArray:
        removal = self.options.max_likelihood.removal
        if len(mixture) == 0:
            return np.zeros(0, dtype=np.bool_)
        mean = component_moments(mixture).mean
        left = outside_observation_area(mean[LON], mean[LAT], situation)
        share = np.exp(mixture.cloud.log_component_weight[mixture.starts[:-1]])
        is_light = share * len(mixture) < removal.weight
        shorter_s = min(removal.unconfirmed_unseen_s, removal.longest_unseen_s)
        patience_s = np.where(mixture.components.confirmed, removal.longest_unseen_s, shorter_s)
        return np.asarray(~left & ~is_light & (mixture.components.unseen_s <= patience_s))


def renormalised(mixture: Mixture) -> Mixture:
    """Return the same distribution with weights that sum to one within the present components and over them."""
    if len(mixture) == 0:
        return mixture
    cloud = mixture.cloud
    log_mass = cloud.log_component_weight + cloud.log_weight
    log_component = _log_sums(log_mass, mixture)
    log_weight = log_mass - log_component[cloud.component]
    log_component = log_component - logsumexp(log_component)
    cloud = replace(cloud, log_weight=log_weight, log_component_weight=log_component[cloud.component])
    return replace(mixture, cloud=cloud)


def largest_log_likelihood(
    mixture: Mixture, detections: Detections, performs_update: BoolArray
) -> tuple[FloatArray, IntArray]:
    """Return each particle's largest log likelihood over all detections, and which detection that is.

    Args:
        mixture: The belief.
        detections: The scan's detections.
        performs_update: Components that take part, shape (m,); the others' particles get 0 and -1.
    """
    log_likelihood = np.zeros(len(mixture.cloud))
    chosen = np.full(len(mixture.cloud), -1, dtype=np.int64)
    if len(detections) > 0:
        _search_largest(
            mixture.cloud.state,
            performs_update[mixture.cloud.component],
            np.stack([detections.lon_m, detections.lat_m, detections.speed_mps]),
            np.stack([detections.std_lon_m, detections.std_lat_m, detections.std_speed_mps]),
            log_likelihood,
            chosen,
        )
    return log_likelihood, chosen


def _component_weights(
    log_before: FloatArray, log_sum: FloatArray, performs_update: BoolArray, floor_weight: float
) -> FloatArray:
    """Return log pi of equation (11), from that before the scan; arrays of shape (m,).

    Equation (11) is for components that are all measured. Those that perform no update keep their weight, and the
    others share what is left, since a sum of likelihoods (a density) can't be weighed against no measurement.
    """
    log_component = log_before.copy()
    if performs_update.any():
        log_mass = logsumexp(log_component[performs_update])
        updated = log_component[performs_update] + log_sum[performs_update]
        log_component[performs_update] = updated - logsumexp(updated) + log_mass
    if floor_weight > 0.0:
        log_component = np.maximum(log_component, np.log(floor_weight / len(log_before)))
        log_component -= logsumexp(log_component)
    return log_component


def _log_sums(log_values: FloatArray, mixture: Mixture) -> FloatArray:
    """Return the log of the sum of exponentials over each component's particles, shape (m,)."""
    if len(mixture) == 0:
        return np.zeros(0)
    largest = np.maximum.reduceat(log_values, mixture.starts[:-1])
    scaled = np.exp(log_values - largest[mixture.cloud.component])
    return np.asarray(largest + np.log(np.add.reduceat(scaled, mixture.starts[:-1])))


def _merge_overlaps(mixture: Mixture, options: PaperMerging, hidden_after_s: float) -> tuple[Mixture, int]:
    """Pool the particles of components whose means overlap under one identity, chosen by an option."""
    if len(mixture) < 2:
        return mixture, 0
    overlap = touching(component_moments(mixture), options)
    index, components = np.arange(len(mixture)), mixture.components
    # Components are in the order of their birth, so that the first is the elder.
    hidden = components.unseen_s > hidden_after_s
    rank = np.argsort(np.lexsort((index, hidden, ~components.confirmed))) if options.keep_seen else index
    into = np.where(overlap, rank, len(mixture)).argmin(axis=1)
    survives = into == index
    if survives.all():
        return mixture, 0
    into = np.where(survives[into], into, index)
    survives = into == index
    if options.keep_seen:
        unseen_s = components.unseen_s.copy()
        np.minimum.at(unseen_s, into, components.unseen_s)
        mixture = replace(mixture, components=replace(components, unseen_s=unseen_s))
    return renormalised(with_component_index(mixture, into[mixture.cloud.component])), int((~survives).sum())


@kernel()
def _search_largest(
    state: FloatArray,
    performs_update: BoolArray,
    measured: FloatArray,
    std: FloatArray,
    log_likelihood: FloatArray,
    chosen: IntArray,
) -> None:
    for n in range(state.shape[1]):
        if not performs_update[n]:
            continue
        best = -np.inf
        for j in range(measured.shape[1]):
            lon = (state[LON, n] - measured[0, j]) / std[0, j]
            lat = (state[LAT, n] - measured[1, j]) / std[1, j]
            value = -0.5 * (lon * lon + lat * lat) - np.log(2.0 * np.pi * std[0, j] * std[1, j])
            if np.isfinite(measured[2, j]):
                speed = (state[SPEED, n] - measured[2, j]) / std[2, j]
                value -= 0.5 * speed * speed + np.log(np.sqrt(2.0 * np.pi) * std[2, j])
            if value > best:
                best, chosen[n] = value, j
        log_likelihood[n] = best
