"""Updates the posterior of each component's kind of source from scan to scan."""

import numpy as np

from mmpf.belief.moments import Moments
from mmpf.joint.false_objects import FalseObjects
from mmpf.joint.kinds import FALSE, VEHICLE, Sightings, bounded, normalised, relaxed_shading, weighed
from mmpf.joint.overlap import driven_through, overlapping, probability_on_ego
from mmpf.joint.sources import Sources
from mmpf.joint.speeds import log_speed_likelihoods, stood_log_after, stopped_among, stopped_shares
from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import FilterOptions
from mmpf.options.joint import JointOptions
from mmpf.stages.update_rule import Situation

OVERLAP_SHARE = 0.6
"""Two objects nearer than this share of a length and a width cannot both be vehicles."""
OVERLAP_PER_S = 3.0
"""Log odds that the less probable of the two loses per second; on the ego itself every object loses them."""


def ended_meanwhile(
    sources: Sources, learned: FalseObjects, dt_s: float, options: JointOptions
) -> tuple[FloatArray, FloatArray]:
    """Return each case's survival before a scan: vehicles rarely disappear, false objects do.

    Args:
        sources: The components after the scan before.
        learned: What false objects are like.
        dt_s: Time since that scan.
        options: Settings of the joint rule.

    Returns:
        Probability of each kind of source that is still there, shape (m, *SHAPE), and of false objects that have ended,
        shape (m, 2, levels).
    """
    vehicles = options.vehicles
    alive = sources.existence[:, None, None, None] * sources.kinds
    ends = -np.expm1(-dt_s / learned.mean_life_s(options.false_objects))[None, :, None]
    ended = sources.ended + ends * alive[:, FALSE].sum(axis=2)
    survival = np.concatenate([np.full((1, 1, 1), np.exp(-options.existence.death_rate_per_s * dt_s)), 1.0 - ends], 1)
    alive = alive * survival[..., None]
    shading = learned.vehicle_shading(vehicles)
    return relaxed_shading(alive, shading, -np.expm1(-dt_s / vehicles.shading_s)), ended


def kinds_after(
    sources: Sources,
    before: Sources,
    alive: FloatArray,
    ended: FloatArray,
    moments: Moments,
    sightings: Sightings,
    learned: FalseObjects,
    situation: Situation,
    options: FilterOptions,
) -> Sources:
    """Return the components with existence and kinds after a scan.

    Args:
        sources: The components, otherwise as they are after the scan.
        before: The components before it.
        alive: Probability of each case before it, from ``ended_meanwhile``, shape (m, *SHAPE).
        ended: Probability of false objects that have ended, from there too, shape (m, 2, levels).
        moments: Moments before it.
        sightings: What the sensor would make of the sources.
        learned: What false objects are like.
        situation: The scan and the traffic around.
        options: The filter's settings.
    """
    joint = options.joint
    nothing = np.maximum(1.0 - alive.sum(axis=(1, 2, 3)) - ended.sum(axis=(1, 2)), 0.0)
    alive = weighed(alive, sightings)
    total = nothing + ended.sum(axis=(1, 2)) + alive.sum(axis=(1, 2, 3))
    existence = np.minimum(alive.sum(axis=(1, 2, 3)) / total, joint.existence.largest)
    ended = ended / total[:, None, None]
    kinds = normalised(alive)
    speed_log, stood_log = before.speed_log, before.stood_log
    if joint.kinds.weighed:
        seen = sources.unseen_s == 0.0
        usual = stopped_shares(moments, situation.plane.road, joint.speeds)
        usual = stopped_among(before, moments, learned.standing_share(usual, joint.vehicles))
        stopped = usual * before.standing_ratio / (1.0 - usual + usual * before.standing_ratio)
        stood_log = np.where(seen, stood_log_after(stood_log, moments), stood_log)
        now = log_speed_likelihoods(moments, situation.traffic, options.birth.local_range_m, stopped, stood_log)
        speed_log = np.where(seen[:, None], now, speed_log)
        gain = speed_log - before.speed_log
        gain[:, VEHICLE] -= _overlap_loss(before, moments, options, situation)
        correlation = joint.kinds.score_correlation
        gain[:, VEHICLE] += sources.score_log_odds(correlation) - before.score_log_odds(correlation)
        kinds = normalised(kinds * np.exp(gain - gain.max(axis=1, keepdims=True))[:, :, None, None])
        kinds = bounded(kinds, 1.0 / (1.0 + np.exp(joint.kinds.largest_log_odds)))
    return sources.having(existence=existence, kinds=kinds, ended=ended, speed_log=speed_log, stood_log=stood_log)


def _overlap_loss(sources: Sources, moments: Moments, options: FilterOptions, situation: Situation) -> FloatArray:
    """Return the log odds of a vehicle that components lose by lying where another or the ego is, shape (m,).

    Of two visible ones that stay there the less probable loses. Where one drives through the other they cannot both be
    vehicles: on the whole way each one's odds are multiplied by the probability that the other is none, or that they do
    not touch. On the ego every component loses, hidden or not.
    """
    joint, share, dt_s = options.joint, sources.vehicle_share, situation.dt_s
    is_seen = sources.unseen_s <= options.reporting.hidden_after_s
    overlaps = overlapping(sources, moments, OVERLAP_SHARE)
    overlaps &= is_seen[:, None] & is_seen & (share[:, None] < share)
    stays = np.where(np.asarray(overlaps.any(axis=1)), OVERLAP_PER_S * dt_s, 0.0)
    touch, share_of_way = driven_through(sources, moments, joint.merging.speed_mps, dt_s)
    passes = -(share_of_way * np.log1p(-touch * (sources.vehicle * is_seen))).sum(axis=1)
    on_ego = probability_on_ego(sources, moments, situation.plane, OVERLAP_SHARE)
    return np.asarray(np.maximum(np.maximum(stays, is_seen * passes), on_ego * OVERLAP_PER_S * dt_s))
