"""Merges components that represent one vehicle."""

from dataclasses import replace

import numpy as np

from mmpf.belief.mixture import NEVER, Mixture
from mmpf.belief.moments import Moments
from mmpf.belief.sizes import sizes_of, with_measured_sizes
from mmpf.joint.kinds import VEHICLE, normalised
from mmpf.joint.mistaken import PLACED, with_mistakes
from mmpf.joint.sources import Sources, sources_of
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, turned
from mmpf.options.joint import JointMerging

SAME_WAY = 0.5
"""Cosine of 60 degrees. Components whose directions differ by more are two vehicles."""
EXISTENCE_ABOVE = 0.3
"""Less probable components do not merge, so that a stray detection cannot replace a track."""
VEHICLE_ABOVE = 0.2
"""A less probable vehicle is not merged with a hidden one, so that no false object takes over its track."""


def merge_lasting_overlaps(
    mixture: Mixture,
    moments: Moments,
    alive: BoolArray,
    options: JointMerging,
    hidden_after_s: float,
    dt_s: float,
) -> tuple[Mixture, BoolArray]:
    """Merge components that have overlapped for long enough; the older identity stays.

    Two vehicles pass each other in neighbouring lanes all the time, and a hidden component may drift over a seen
    one: so they must be well within one footprint for long enough, and two that are both confirmed must be both hidden,
    or both seen but not both detected in this scan: who has a detection each is two.

    Args:
        mixture: The belief.
        moments: Its components' moments.
        alive: Components that may merge, shape (m,); the others are about to be removed.
        options: How near in place and speed components overlap, and for how long before they merge.
        hidden_after_s: Unseen for longer, a component counts as hidden.
        dt_s: Time since the scan before.

    Returns:
        The belief with all its particles still, and which components to keep: those alive and not merged away.
    """
    components = sources_of(mixture)
    if len(mixture) == 0:
        return mixture, alive
    mean, lon_m, lat_m = moments.mean, options.lon_m, options.lat_m
    is_hidden = components.unseen_s > hidden_after_s
    along, across = turned(mean[LON][:, None] - mean[LON], mean[LAT][:, None] - mean[LAT], moments.heading_rad[:, None])
    apart = (np.abs(along) >= lon_m) | (np.abs(across) >= lat_m)
    apart |= np.abs(mean[SPEED][:, None] - mean[SPEED][None, :]) >= options.speed_mps
    both = components.confirmed[:, None] & components.confirmed[None, :]
    there = alive & (components.existence > EXISTENCE_ABOVE)
    apart |= ~(there[:, None] & there[None, :])
    has_own_detection = components.unseen_s == 0.0
    apart |= both & has_own_detection[:, None] & has_own_detection[None, :]
    apart |= both & (is_hidden[:, None] != is_hidden[None, :])
    takes = (is_hidden & components.confirmed)[:, None] & (components.vehicle < VEHICLE_ABOVE)
    apart |= takes | takes.T
    np.fill_diagonal(apart, val=True)
    one, other = np.nonzero(~apart)
    same_way = heads_the_same_way(moments.heading_rad[one], moments.heading_rad[other])
    one, other = one[same_way], other[same_way]
    distance = np.full(apart.shape, np.inf)
    distance[one, other] = np.hypot(along[one, other] / lon_m, across[one, other] / lat_m)
    nearest = distance.argmin(axis=1)
    overlaps = np.isfinite(distance[np.arange(len(mixture)), nearest])
    partner = np.where(overlaps, components.track_id[nearest], NEVER)
    before_s = np.where(partner == components.overlap_with, components.overlap_s, 0.0)
    overlap_s = np.where(overlaps, before_s + dt_s, 0.0)
    keep = alive.copy()
    track_id, confirmed = components.track_id.copy(), components.confirmed.copy()
    for a in np.flatnonzero(overlap_s > options.after_s):
        b = nearest[a]
        # One of three may have got another's identity just now. Whether a confirmed third is the same vehicle is judged
        # in the next scan.
        if not (keep[a] and keep[b]) or (confirmed[a] and confirmed[b] and not both[a, b]):
            continue
        elder = min((a, b), key=lambda m: (not confirmed[m], track_id[m]))
        better, worse = sorted((a, b), key=lambda m: (components.unseen_s[m], -components.hits[m]))
        if confirmed[worse] and not confirmed[better]:
            components = with_known_vehicles(components, moments, np.array([better]), np.array([worse]), np.ones(1))
        track_id[better], confirmed[better] = track_id[elder], confirmed[elder]
        keep[worse] = False
        components = with_measured_sizes(components, np.array([better]), sizes_of(components, np.array([worse])))
    updated = components.having(track_id=track_id, confirmed=confirmed, overlap_with=partner, overlap_s=overlap_s)
    return replace(mixture, components=updated), keep


def heads_the_same_way(one_rad: FloatArray, other_rad: FloatArray) -> BoolArray:
    """Return whether two directions can be those of one vehicle, the shape of both together."""
    return np.asarray(np.cos(one_rad - other_rad) >= SAME_WAY)


def with_known_vehicles(
    components: Sources, moments: Moments, heirs: IntArray, known: IntArray, same: FloatArray
) -> Sources:
    """Return the components after some of them, the heirs, have inherited what reported components were known to be.

    With h and k the probabilities that heir and known component are vehicles, the heir becomes a vehicle with the
    probability 1 - (1 - h) (1 - same k): by its own detections, or because it is the known vehicle, whose detectability
    then holds for it. Its own detections alone would leave it in doubt, since few vehicles first appear in plain view.
    What else the heir may be, such as a false object that has ended, it is with its probability times 1 - same k.
    A vehicle that is the known one was born where that one was: ``born_in_view`` becomes the mean over both cases.
    The probability that it is not the known vehicle, 1 - same h, is kept as that of a mistake (``with_mistakes``).

    Args:
        components: The components.
        moments: Their moments.
        heirs: Indices of the components that stay, shape (k,).
        known: Index of the reported component that each replaces, which is about to be removed, shape (k,).
        same: Probability that both are the same source, given that the known one is a vehicle, shape (k,).
    """
    hidden, offset = moments.take(known), moments.mean[PLACED][:, heirs] - moments.mean[PLACED][:, known]
    components = with_mistakes(components, heirs, 1.0 - same * components.vehicle[heirs], offset, hidden)
    kinds, existence, ended = components.kinds.copy(), components.existence.copy(), components.ended.copy()
    vehicles = (same * existence[known])[:, None, None] * kinds[known, VEHICLE]
    another = 1.0 - vehicles.sum(axis=(1, 2))
    alive = (another * existence[heirs])[:, None, None, None] * kinds[heirs]
    alive[:, VEHICLE] += vehicles
    kinds[heirs], existence[heirs] = normalised(alive), alive.sum(axis=(1, 2, 3))
    ended[heirs] *= another[:, None, None]
    own, in_view = another * components.vehicle[heirs], components.born_in_view.copy()
    known_share = (1.0 - another) / np.maximum(1.0 - another + own, 1e-300)
    in_view[heirs] += known_share * (in_view[known] - in_view[heirs])
    return components.having(kinds=kinds, existence=existence, ended=ended, born_in_view=in_view)
