"""Finetune by k-medoids: particles near several components are reassigned; identities stay with the medoids."""

from dataclasses import replace

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.options.paper import PaperMerging, PaperReclustering

ROUNDS = 10
VOTERS = 200
"""Number of particles of a group that determine the medoids; the others join the nearest one."""


def recluster(
    mixture: Mixture, moments: Moments, options: PaperReclustering, rng: np.random.Generator
) -> tuple[Mixture, int]:
    """Reassign the particles of touching components to their nearest medoids.

    k stays the number of components and the medoids start from the components' own, so that each cluster inherits
    the identity of the component that it grew from. The distribution is unchanged: only the component index moves.
    A component left without particles disappears. Those touch whose means are nearer than both distances, and a sample
    of a group's particles votes on its medoids.

    Returns:
        The belief, and the number of components whose particles were dealt out anew.
    """
    if len(mixture) < 2:
        return mixture, 0
    mean = moments.mean
    groups, group_of = connected_components(touching(moments, options), directed=False)
    scale = np.array([[options.lon_m], [options.lat_m]])
    position = mixture.cloud.state[[LON, LAT]] / scale
    component = mixture.cloud.component.copy()
    log_vote = mixture.cloud.log_weight + mixture.cloud.log_component_weight
    if options.alike:
        log_vote = np.zeros(len(mixture.cloud))
    reclustered = 0
    for group in range(groups):
        members = np.flatnonzero(group_of == group)
        if len(members) < 2:
            continue
        particles = np.flatnonzero(np.isin(mixture.cloud.component, members))
        share = np.cumsum(np.exp(log_vote[particles] - log_vote[particles].max()))
        voters = particles[np.searchsorted(share, share[-1] * rng.uniform(size=VOTERS)).clip(0, len(particles) - 1)]
        medoids = k_medoids(position[:, voters].T, (mean[[LON, LAT]] / scale)[:, members].T)
        component[particles] = members[cdist(position[:, particles].T, medoids).argmin(axis=1)]
        reclustered += len(members)
    return with_component_index(mixture, component), reclustered


def touching(moments: Moments, within: PaperReclustering | PaperMerging) -> BoolArray:
    """Return which components' means are nearer to each other than both distances, shape (m, m)."""
    lon, lat = moments.mean[LON], moments.mean[LAT]
    return np.asarray((np.abs(lon[:, None] - lon) < within.lon_m) & (np.abs(lat[:, None] - lat) < within.lat_m))


def k_medoids(points: FloatArray, start: FloatArray) -> FloatArray:
    """Return k medoids by alternating assignment and medoid search (Park and Jun 2009).

    Args:
        points: Points to cluster, shape (n, dimensions).
        start: Where the medoids start, shape (k, dimensions); each moves to the nearest point first.

    Returns:
        The medoids, rows of ``points`` in the order of ``start``, shape (k, dimensions).
    """
    distance = cdist(points, points)
    medoids = cdist(start, points).argmin(axis=1)
    for _ in range(ROUNDS):
        assignment = distance[medoids].argmin(axis=0)
        moved = np.array([_medoid_of(distance, assignment == k, old) for k, old in enumerate(medoids)])
        if (moved == medoids).all():
            break
        medoids = moved
    return np.asarray(points[medoids])


def _medoid_of(distance: FloatArray, is_member: BoolArray, otherwise: int) -> int:
    members = np.flatnonzero(is_member)
    if len(members) == 0:
        return otherwise
    return int(members[distance[np.ix_(members, members)].sum(axis=1).argmin()])


def with_component_index(mixture: Mixture, component: IntArray) -> Mixture:
    """Return the belief with its particles dealt out anew, shape (n,), without components that got none."""
    order = np.argsort(component, kind="stable")
    cloud = mixture.cloud.take(order, component[order])
    occupied = np.bincount(component, minlength=len(mixture)) > 0
    return replace(mixture, cloud=cloud).keep(occupied)
