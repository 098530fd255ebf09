"""Re-identification: a new component where a hidden one may be is that hidden vehicle, seen again.

So is one that is confirmed where another was just found to be no vehicle: that one had been following something false
beside the vehicle, or the other of two boxes of it.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import expit

from mmpf.belief.mixture import Mixture, is_longer
from mmpf.belief.moments import Moments
from mmpf.belief.sizes import sizes_of, with_measured_sizes
from mmpf.joint.merging import heads_the_same_way, with_known_vehicles
from mmpf.joint.sources import sources_of
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, turned
from mmpf.options.joint import JointIdentity
from mmpf.stages.update_rule import Finetuned

KERNEL_WIDTHS = 2.0, 0.7, 2.0
"""Widths of the kernel around each of the hidden component's particles: longitudinal, lateral, in speed."""
BOTH_SEEN_S = 0.5
"""Longest time after the new component's birth at which the hidden one may still have had detections."""


def hand_over_identity(
    mixture: Mixture,
    moments: Moments,
    confirmed_now: BoolArray,
    options: JointIdentity,
    scan_s: float,
) -> Finetuned:
    """Give newly confirmed components the identities of the hidden or withdrawn components that they probably are.

    Each pair is judged by the density that the old component's particles give to the new one's place and speed,
    against the density of vehicles that were never seen before; all pairs together by optimal assignment. A hidden
    component is gone thereby; a withdrawn one, which is still detected, goes on under the new one's number.
    Whoever takes a hidden one's place keeps its probability of a vehicle; see ``with_known_vehicles``.

    Args:
        mixture: The belief.
        moments: Its components' moments.
        confirmed_now: Components confirmed in this scan, shape (m,).
        options: The density of unknown vehicles.
        scan_s: Time between scans.

    Returns:
        The belief without the hidden components that were seen again.
    """
    components = sources_of(mixture)
    is_hidden = components.confirmed & ~confirmed_now & is_longer(components.unseen_s, 2.0 * scan_s)
    old = np.flatnonzero(is_hidden | components.withdrawn)
    new = np.flatnonzero(confirmed_now)
    if len(old) == 0 or len(new) == 0:
        return Finetuned(mixture, moments=moments)
    density = _density_at(mixture, moments, new, old) * components.existence[old]
    was_unseen_by_then = is_longer(components.unseen_s[old], components.age_s[new][:, None] - BOTH_SEEN_S)
    possible = was_unseen_by_then | components.withdrawn[old]
    possible &= heads_the_same_way(moments.heading_rad[new][:, None], moments.heading_rad[old])
    log_ratio = np.log(np.maximum(np.where(possible, density, 0.0), 1e-300) / options.unknown_density)
    rows, columns = linear_sum_assignment(np.maximum(log_ratio, 0.0), maximize=True)
    linked = log_ratio[rows, columns] > 0.0
    heirs, left = new[rows[linked]], old[columns[linked]]
    again = is_hidden[left]
    same = expit(log_ratio[rows, columns][linked][again])
    components = with_known_vehicles(components, moments, heirs[again], left[again], same)
    track_id, withdrawn = components.track_id.copy(), components.withdrawn.copy()
    track_id[heirs], track_id[left] = components.track_id[left], components.track_id[heirs]
    withdrawn[left] = False
    keep = np.ones(len(mixture), dtype=np.bool_)
    keep[left[again]] = False
    components = with_measured_sizes(components, heirs, sizes_of(components, left))
    renamed = replace(mixture, components=components.having(track_id=track_id, withdrawn=withdrawn))
    return Finetuned(renamed.keep(keep), int(linked.sum()), moments.take(keep))


def _density_at(mixture: Mixture, moments: Moments, new: IntArray, old: IntArray) -> FloatArray:
    """Return the density that the old components' particles give to the new ones' place and speed, shape (k, h)."""
    cloud, starts = mixture.cloud, mixture.starts
    sizes = np.diff(starts)[old]
    begins = np.cumsum(sizes) - sizes
    particles = np.arange(sizes.sum()) + np.repeat(starts[old] - begins, sizes)
    off_lon, off_lat, faster = (cloud.state[row, particles] - moments.mean[row, new, None] for row in (LON, LAT, SPEED))
    along, across = turned(off_lon, off_lat, moments.heading_rad[new, None])
    squares = sum((off / width) ** 2 for off, width in zip((along, across, faster), KERNEL_WIDTHS, strict=True))
    shares = np.exp(cloud.log_weight[particles] - 0.5 * squares)
    return np.asarray(np.add.reduceat(shares, begins, axis=1) / ((2.0 * np.pi) ** 1.5 * np.prod(KERNEL_WIDTHS)))
