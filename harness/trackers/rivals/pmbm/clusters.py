"""Clusters of tracks whose hypotheses depend on each other.

A cluster's global hypotheses say which single hypotheses of its tracks hold together. Tracks that can't have the same
detection are in different clusters, so that their ambiguities add up and do not multiply (Reid 1979; Fontana,
Garcia-Fernandez and Maskell 2020).
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness.trackers.rivals.pmbm.murty import NOBODY, Assignment, best_assignments, of_one
from mmpf.numerics.arrays import FloatArray

NO_TRACK = -1

Key = tuple[int, int]


@dataclass(frozen=True)
class Pruning:
    """What is left out.

    Attributes:
        most: So many global hypotheses of a cluster are kept.
        least_weight: Smallest weight of one, as a share of the best.
        least_existence: Single hypotheses that exist with less than this probability are dropped.
        alike_scans: Global hypotheses by which, whatever the tracks' identities, the same vehicles had the same
            detections for so many scans are one, with the identities of the best of them; 0 keeps them apart. After so
            long their densities are nearly the same, and no later scan can tell which is right.
    """

    gate_std: float
    most: int
    least_weight: float
    least_existence: float
    alike_scans: int = 0


@dataclass(frozen=True)
class Cluster:
    """Tracks with common global hypotheses. There are few of either, which is why these are no arrays.

    Attributes:
        rows: Single hypothesis of each track in each global one, ``NO_TRACK`` where it does not exist; best first.
        log_weight: Logarithms of the global hypotheses' weights, which sum to one.
    """

    rows: tuple[tuple[int, ...], ...]
    log_weight: tuple[float, ...]


@dataclass(frozen=True)
class ScanLikelihoods:
    """What a scan says of single hypotheses, h of them, and detections, d of them, all in logarithms.

    Attributes:
        hit: That the hypothesis exists and the detection is its, minus infinity outside the gate, shape (h, d).
        miss: That it does not exist, or was missed, of each hypothesis.
        new: That the detection is clutter, or of somebody who was never detected, of each detection.
    """

    hit: FloatArray
    miss: list[float]
    new: list[float]


@dataclass(frozen=True)
class ClusterOutcome:
    """A cluster after a scan in keys: for each single hypothesis its predecessor and its detection.

    The former may be ``NO_TRACK``, the latter ``NOBODY``.

    Attributes:
        keys: Key of each track in each global hypothesis; None where it does not exist.
        log_weight: As ``Cluster.log_weight``.
    """

    keys: tuple[tuple[Key | None, ...], ...]
    log_weight: tuple[float, ...]


def together(gated: Sequence[Sequence[int]]) -> list[tuple[list[int], list[int]]]:
    """Group clusters that share a detection.

    Args:
        gated: Detections in the gate of any hypothesis of each cluster.

    Returns:
        Of each group its clusters and its detections, in order.
    """
    group_of_detection: dict[int, int] = {}
    members: dict[int, tuple[list[int], set[int]]] = {}
    for number, detections in enumerate(gated):
        old = sorted({group_of_detection[each] for each in detections if each in group_of_detection})
        first = old[0] if old else number
        inside, seen = members.setdefault(first, ([], set()))
        for other in old[1:]:
            moved, its = members.pop(other)
            inside.extend(moved)
            seen.update(its)
        inside.append(number)
        seen.update(detections)
        for each in seen:
            group_of_detection[each] = first
    return [(sorted(inside), sorted(seen)) for inside, seen in members.values()]


def merged(clusters: Sequence[Cluster], pruning: Pruning) -> Cluster:
    """Return one cluster of all: every combination of global hypotheses, the best of them kept."""
    first, *others = clusters
    for other in others:
        weights = [one + two for one in first.log_weight for two in other.log_weight]
        kept = _best(weights, pruning)
        many = len(other.rows)
        rows = tuple(first.rows[k // many] + other.rows[k % many] for k in kept)
        first = Cluster(rows, normalised([weights[k] for k in kept]))
    return first


def explained(
    cluster: Cluster, detections: Sequence[int], evidence: ScanLikelihoods, pruning: Pruning
) -> ClusterOutcome:
    """Return a cluster after a scan: the best assignments of its detections under each global hypothesis."""
    keys: list[tuple[Key | None, ...]] = []
    weights: list[float] = []
    for row, log_weight in zip(cluster.rows, cluster.log_weight, strict=True):
        singles = [single for single in row if single != NO_TRACK]
        base = log_weight + sum(evidence.miss[single] for single in singles)
        missed = tuple(None if single == NO_TRACK else (single, NOBODY) for single in row)
        if not detections:
            keys.append(missed)
            weights.append(base)
            continue
        base += sum(evidence.new[each] for each in detections)
        count = max(1, math.ceil(pruning.most * math.exp(log_weight)))
        for worth, tracks in _assigned(singles, detections, evidence, count, pruning):
            got = {singles[track]: each for each, track in zip(detections, tracks, strict=True) if track != NOBODY}
            own = (None if key is None else (key[0], got.get(key[0], NOBODY)) for key in missed)
            new = (
                (NO_TRACK, each) if track == NOBODY else None for each, track in zip(detections, tracks, strict=True)
            )
            keys.append((*own, *new))
            weights.append(base + worth)
    kept = _best(weights, pruning)
    return ClusterOutcome(tuple(keys[k] for k in kept), normalised([weights[k] for k in kept]))


def united(cluster: Cluster, told: Sequence[Hashable | None]) -> Cluster:
    """Return a cluster in which the best of those global hypotheses that say the same stands for all of them.

    Args:
        told: What each single hypothesis says, none if it hardly counts; who says it makes no difference.
    """
    return _summed(cluster, [frozenset(told[single] for single in row if single != NO_TRACK) for row in cluster.rows])


def simplified(cluster: Cluster) -> list[Cluster]:
    """Return a cluster without duplicate hypotheses; tracks on which all global hypotheses agree are split off."""
    if len(cluster.rows) == 1:
        return [Cluster(((single,),), (0.0,)) for single in cluster.rows[0] if single != NO_TRACK]
    cluster = _summed(cluster, cluster.rows)
    columns = list(zip(*cluster.rows, strict=True))
    same = [k for k, column in enumerate(columns) if column.count(column[0]) == len(column)]
    sure = [Cluster(((columns[k][0],),), (0.0,)) for k in same if columns[k][0] != NO_TRACK]
    left = [column for k, column in enumerate(columns) if k not in same]
    return [*sure, Cluster(tuple(zip(*left, strict=True)), cluster.log_weight)] if left else sure


def renumbered(cluster: Cluster, place: Mapping[int, int]) -> Cluster:
    """Return a cluster whose single hypotheses have other numbers: of each, and of ``NO_TRACK``, its new one."""
    return Cluster(tuple(tuple(place[single] for single in row) for row in cluster.rows), cluster.log_weight)


def normalised(log_weight: Sequence[float]) -> tuple[float, ...]:
    """Return logarithms of weights that sum to one."""
    highest = max(log_weight)
    total = highest + math.log(sum(math.exp(each - highest) for each in log_weight))
    return tuple(each - total for each in log_weight)


def _assigned(
    singles: Sequence[int], detections: Sequence[int], evidence: ScanLikelihoods, count: int, pruning: Pruning
) -> list[Assignment]:
    """Return the best assignments of detections to hypotheses, by their places among them."""
    if not singles:
        return [(0.0, (NOBODY,) * len(detections))]
    worst_loss = -math.log(pruning.least_weight)
    gain = [
        [float(evidence.hit[single, k]) - evidence.miss[single] - evidence.new[k] for single in singles]
        for k in detections
    ]
    return of_one(gain[0], count, worst_loss) if len(gain) == 1 else best_assignments(np.array(gain), count, worst_loss)


def _summed(cluster: Cluster, says: Sequence[Hashable]) -> Cluster:
    """Return a cluster in which the first of the global hypotheses that say the same has the weight of all of them."""
    place: dict[Hashable, int] = {}
    weights: list[float] = []
    kept: list[int] = []
    for k, what in enumerate(says):
        at = place.setdefault(what, len(kept))
        if at < len(kept):
            weights[at] = float(np.logaddexp(weights[at], cluster.log_weight[k]))
        else:
            kept.append(k)
            weights.append(cluster.log_weight[k])
    if len(kept) == len(cluster.rows):
        return cluster
    order = sorted(range(len(kept)), key=lambda k: -weights[k])
    return Cluster(tuple(cluster.rows[kept[k]] for k in order), tuple(weights[k] for k in order))


def _best(log_weight: Sequence[float], pruning: Pruning) -> list[int]:
    """Return the weightiest hypotheses, best first."""
    order = sorted(range(len(log_weight)), key=lambda k: -log_weight[k])[: pruning.most]
    least = log_weight[order[0]] + math.log(pruning.least_weight)
    return [k for k in order if log_weight[k] >= least]
