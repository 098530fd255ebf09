"""The Poisson multi-Bernoulli mixture filter in its track-oriented form.

After Williams (IEEE T-AES 51, 2015) and Garcia-Fernandez, Williams, Granstrom and Svensson (IEEE T-AES 54, 2018), with
linear motion and Gaussian densities. A track is a detection and those that may have followed it; each of its single
hypotheses is a Bernoulli: it exists with some probability, and then lies where a Gaussian says. What was never detected
is a Poisson process, of which this module is told what it expects at each detection.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.trackers.kalman import GaussianStates, updated
from harness.trackers.rivals.gaussian import pairs_of
from harness.trackers.rivals.lives import Lives
from harness.trackers.rivals.pmbm.clusters import (
    NO_TRACK,
    Cluster,
    ClusterOutcome,
    Key,
    Pruning,
    ScanLikelihoods,
    explained,
    merged,
    renumbered,
    simplified,
    together,
    united,
)
from harness.trackers.rivals.pmbm.murty import NOBODY
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, joined, taken
from mmpf.scan import Detections


@dataclass(frozen=True)
class Singles:
    """Single hypotheses of all tracks, h of them.

    Attributes:
        size_m: Mean of its measured lengths and widths, shape (h, 2).
        recent: Its detections of the last scans, the newest last, as the identities of the tracks that they might have
            begun; ``NOBODY`` where it was missed; shape (h, k).
    """

    lives: Lives
    states: GaussianStates
    existence: FloatArray
    size_m: FloatArray
    recent: IntArray


@dataclass(frozen=True)
class HypothesisMixture:
    """What is believed of all vehicles that were ever detected."""

    singles: Singles
    clusters: tuple[Cluster, ...]

    @property
    def best(self) -> IntArray:
        """Single hypotheses of the most probable global one, by number."""
        best = [single for cluster in self.clusters for single in cluster.rows[0] if single != NO_TRACK]
        return np.array(best, dtype=np.int64)


@dataclass(frozen=True)
class MeasuredHypotheses:
    """A scan as the filter takes it.

    Attributes:
        seen: Probability with which each single hypothesis would be detected, shape (h,).
        clutter_density: Expected clutter a square metre, at each, shape (d,).
        newcomers: Expected number of detections a square metre, at each one, of vehicles never detected, shape (d,).
        first: What is believed of a vehicle that is first detected by each, d of them, and its track's identity.
    """

    time_s: float
    detections: Detections
    sizes_m: FloatArray
    seen: FloatArray
    clutter_density: FloatArray
    newcomers: FloatArray
    first: tuple[Lives, GaussianStates]


COUNTED_EXISTENCE = 0.1
"""Who exists with less than this probability makes no difference to which hypotheses are alike."""


def nothing(scans: int = 0) -> HypothesisMixture:
    """Return what is believed before the first scan, with room for the detections of so many scans."""
    states, none = GaussianStates(np.zeros((0, 4)), np.zeros((0, 4, 4))), np.zeros((0, scans), dtype=np.int64)
    return HypothesisMixture(Singles(Lives.begun(1, 0, 0.0), states, np.zeros(0), np.zeros((0, 2)), none), ())


def updated_mixture(mixture: HypothesisMixture, measured: MeasuredHypotheses, pruning: Pruning) -> HypothesisMixture:
    """Return the beliefs after a scan."""
    singles, detections = mixture.singles, measured.detections
    squared, log_density = pairs_of(singles.states.mean, singles.states.covariance, detections)
    inside = squared <= pruning.gate_std**2
    exists_and_seen = np.clip(singles.existence * measured.seen, 1e-12, 1.0 - 1e-12)
    evidence = ScanLikelihoods(
        hit=np.where(inside, np.log(exists_and_seen)[:, None] + log_density, -np.inf),
        miss=np.log1p(-exists_and_seen).tolist(),
        new=np.log(measured.clutter_density + measured.newcomers).tolist(),
    )
    outcomes = _outcomes(mixture.clusters, inside, evidence, pruning)
    keys = sorted({key for outcome in outcomes for row in outcome.keys for key in row if key is not None})
    place: dict[Key | None, int] = {key: k for k, key in enumerate(keys)}
    place[None] = NO_TRACK
    clusters = [
        Cluster(tuple(tuple(place[key] for key in row) for row in outcome.keys), outcome.log_weight)
        for outcome in outcomes
    ]
    after = _singles_after(singles, keys, measured)
    if pruning.alike_scans:
        told = _told(after)
        clusters = [united(cluster, told) if len(cluster.rows) > 1 else cluster for cluster in clusters]
    return without(HypothesisMixture(after, tuple(clusters)), after.existence < pruning.least_existence)


def without(mixture: HypothesisMixture, dropped: BoolArray) -> HypothesisMixture:
    """Return the beliefs without some single hypotheses, shape (h,): as if those did not exist."""
    kept = np.flatnonzero(~dropped).tolist()
    place = {**dict.fromkeys(range(len(dropped)), NO_TRACK), NO_TRACK: NO_TRACK, **dict(zip(kept, kept, strict=True))}
    clusters = [renumbered(cluster, place) for cluster in mixture.clusters]
    return _referenced(mixture.singles, [part for cluster in clusters for part in simplified(cluster)])


def survived(mixture: HypothesisMixture, probability: float) -> HypothesisMixture:
    """Return the beliefs after each vehicle has gone on with some probability."""
    singles = replace(mixture.singles, existence=probability * mixture.singles.existence)
    return replace(mixture, singles=singles)


def _told(singles: Singles) -> list[tuple[int, ...] | None]:
    """Return the recent detections of each single hypothesis; its track where it has none."""
    counts = (singles.existence >= COUNTED_EXISTENCE).tolist()
    return [
        (tuple(recent) if max(recent) != NOBODY else (number,)) if is_counted else None
        for recent, number, is_counted in zip(
            singles.recent.tolist(), singles.lives.track_id.tolist(), counts, strict=True
        )
    ]


def _outcomes(
    clusters: Sequence[Cluster], inside: BoolArray, evidence: ScanLikelihoods, pruning: Pruning
) -> list[ClusterOutcome]:
    near: list[list[int]] = [[] for _ in inside]
    for single, detection in np.argwhere(inside).tolist():
        near[single].append(detection)
    gated = [
        sorted({each for row in cluster.rows for single in row if single != NO_TRACK for each in near[single]})
        for cluster in clusters
    ]
    outcomes = []
    left = set(range(inside.shape[1]))
    for members, detections in together(gated):
        left.difference_update(detections)
        cluster = merged([clusters[k] for k in members], pruning)
        outcomes.append(explained(cluster, detections, evidence, pruning))
    return [*outcomes, *(ClusterOutcome((((NO_TRACK, k),),), (0.0,)) for k in sorted(left))]


def _singles_after(singles: Singles, keys: Sequence[tuple[int, int]], measured: MeasuredHypotheses) -> Singles:
    """Return the single hypotheses that follow, in the order of their keys; newcomers' come first."""
    table = np.array(keys, dtype=np.int64).reshape(-1, 2)
    is_new = table[:, 0] == NO_TRACK
    newly = table[is_new, 1]
    lives, states = measured.first
    rate = measured.newcomers[newly]
    scans = singles.recent.shape[1]
    only_now = np.full((len(newly), scans), NOBODY)
    only_now[:, scans - 1 :] = lives.track_id[newly, None]
    begun = Singles(
        taken(lives, newly),
        taken(states, newly),
        rate / (rate + measured.clutter_density[newly]),
        measured.sizes_m[newly],
        only_now,
    )
    before, detection = table[~is_new].T
    follow = taken(singles, before)
    hit = np.flatnonzero(detection != NOBODY)
    by = detection[hit]
    seen = measured.seen[before]
    existence = follow.existence * (1.0 - seen) / np.maximum(1.0 - follow.existence * seen, 1e-12)
    existence[hit] = 1.0
    size_m, number = follow.size_m.copy(), follow.lives.detections[hit, None]
    size_m[hit] += (measured.sizes_m[by] - size_m[hit]) / (number + 1.0)
    now = np.full(len(before), NOBODY)
    now[hit] = lives.track_id[by]
    recent = np.column_stack([follow.recent, now])[:, 1:]
    followed = Singles(
        follow.lives.seen(hit, measured.time_s),
        updated(follow.states, hit, measured.detections, by),
        existence,
        size_m,
        recent,
    )
    return joined(begun, followed)


def _referenced(singles: Singles, clusters: Sequence[Cluster]) -> HypothesisMixture:
    """Return clusters with those single hypotheses that are in any of them."""
    used = sorted({single for cluster in clusters for row in cluster.rows for single in row} - {NO_TRACK})
    place = {single: k for k, single in enumerate(used)}
    place[NO_TRACK] = NO_TRACK
    clusters = [renumbered(cluster, place) for cluster in clusters]
    return HypothesisMixture(taken(singles, np.array(used, dtype=np.int64)), tuple(clusters))
