"""The detection probability of each component, given shadows, distance and runs of misses."""

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments
from mmpf.joint.kinds import Sightings, mean_detectability
from mmpf.joint.known import Known
from mmpf.joint.sources import sources_of
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import FloatArray
from mmpf.options.joint import JointOptions
from mmpf.stages.update_rule import Occlusion, Situation
from mmpf.visibility.depth import Occluders, depth_table
from mmpf.visibility.detection_probability import detection_probabilities, in_plain_view
from mmpf.visibility.field import half_widths, share_in_field, worth_at_edge
from mmpf.visibility.missed_runs import LASTS_ON, run_expected
from mmpf.visibility.range_profile import share_at
from mmpf.visibility.shadows import visible_fractions

OCCLUDER_EXISTENCE = 0.2
"""Components above this probability of a vehicle cast shadows."""


def occlusion_of(
    prior: Mixture, moments: Moments, known: Known, situation: Situation, options: JointOptions
) -> Occlusion:
    """Return each particle's detection probability, given the shadows of the other components.

    Args:
        prior: The belief before the scan.
        moments: Its components' moments.
        known: What the rule has learned of the sensor.
        situation: The scan.
        options: Settings of the joint rule.
    """
    detectability, plane, cloud, sources = options.detectability, situation.plane, prior.cloud, sources_of(prior)
    if detectability.shadow:
        casts = sources.vehicle > OCCLUDER_EXISTENCE
        bodies = Occluders(sources.length_m, sources.width_m, moments.heading_rad)
        table = depth_table(plane, moments.mean[LON], moments.mean[LAT], casts, bodies)
        visible = visible_fractions(plane, cloud.state[LON], cloud.state[LAT], cloud.component, bodies, table)
        half_width = half_widths(sources.length_m, sources.width_m)[cloud.component]
        in_field = share_in_field(plane, cloud.state[LON], cloud.state[LAT], half_width, situation.scan.free_space)
        visible = visible if in_field is None else np.minimum(visible, in_field)
        distance = plane.distance_m(cloud.state[LON], cloud.state[LAT])
        shares = known.reach.shares()
        probability = detection_probabilities(visible, distance, known.sensor, shares, detectability.hidden_probability)
    else:
        probability = np.full(len(cloud), detectability.fixed_probability)
    share, run_s, dt_s = detectability.run_share, detectability.run_s, situation.dt_s
    run = run_expected(sources.missed, share, run_s, dt_s)
    lasting = run_expected(sources.unexplained, share, run_s + LASTS_ON * sources.unseen_s, dt_s)
    seen = (1.0 - run) * mean_detectability(sources.kinds)
    probability *= np.repeat(seen, np.diff(prior.starts))
    return Occlusion(probability, run, np.maximum(lasting, run))


def sightings_of(
    prior: Mixture,
    moments: Moments,
    occlusion: Occlusion,
    not_seen: FloatArray,
    claimed: FloatArray,
    hit: FloatArray,
    known: Known,
    situation: Situation,
    options: JointOptions,
) -> Sightings:
    """Return the expected detection of a fully detectable source at each component's place, and the actual one.

    Args:
        prior: The belief before the scan.
        moments: Its components' moments.
        occlusion: What ``occlusion_of`` says of it.
        not_seen: Probability that each component gives no detection, shape (m,).
        claimed: Weight of all detections that may be each component's, shape (m,).
        hit: Probability that one of them is, shape (m,).
        known: What the rule has learned of the sensor.
        situation: The scan.
        options: Settings of the joint rule.
    """
    sources, mean = sources_of(prior), moments.mean
    expected = (1.0 - occlusion.run_probability) * mean_detectability(sources.kinds)
    distance_m = situation.plane.distance_m(mean[LON], mean[LAT])
    shares = share_at(distance_m, known.reach.shares(), known.reach.ring_m)
    half_width = half_widths(sources.length_m, sources.width_m)
    in_field = share_in_field(situation.plane, mean[LON], mean[LAT], half_width, situation.scan.free_space)
    worth = (
        np.ones(len(prior))
        if in_field is None
        else worth_at_edge(in_field, known.sensor, options.detectability.hidden_probability)
    )
    return Sightings(
        in_shadow=(1.0 - not_seen) / np.maximum(expected, 1e-6),
        in_plain_view=in_plain_view(known.sensor, shares) * worth,
        in_field=worth,
        claimed=claimed / np.maximum(1.0 - not_seen, 1e-12),
        hit=hit,
        run_probability=occlusion.run_probability,
    )
