"""HOTA: higher order tracking accuracy (Luiten et al., IJCV 2021)."""

from dataclasses import dataclass

import numpy as np

from harness.scoring.evidence.assignment import best_assignment
from harness.scoring.evidence.sequence import MotSequence
from mmpf.numerics.arrays import FloatArray, IntArray

THRESHOLDS = np.arange(0.05, 0.99, 0.05)
"""Similarity thresholds alpha that the score is averaged over."""


@dataclass(frozen=True)
class HotaScores:
    """HOTA and its two halves, detection and association accuracy, means over the thresholds, in [0, 1]."""

    hota: float
    deta: float
    assa: float


@dataclass(frozen=True)
class HotaPart:
    """What HOTA counts in a sequence, or in a part of one that shares no identity with the others.

    Attributes:
        truths: Truth rows.
        tracks: Track rows.
        matched: Matches at each threshold, shape (thresholds,).
        association: Sum of the matches' association scores at each threshold, shape (thresholds,).
    """

    truths: int
    tracks: int
    matched: FloatArray
    association: FloatArray

    def scores(self) -> HotaScores:
        """Return the scores; all 0 without truth or without tracks."""
        if not self.truths or not self.tracks:
            return HotaScores(0.0, 0.0, 0.0)
        deta = self.matched / (self.truths + self.tracks - self.matched)
        assa = self.association / np.maximum(1.0, self.matched)
        return HotaScores(float(np.sqrt(deta * assa).mean()), float(deta.mean()), float(assa.mean()))


@dataclass(frozen=True)
class HotaCouples:
    """Each couple of a truth and a track identity that were ever near, shape (couples,).

    ``matches`` at each threshold and their ``association`` score are of shape (couples, thresholds).
    """

    truth: IntArray
    track: IntArray
    matches: FloatArray
    association: FloatArray


def measure_hota(sequence: MotSequence) -> HotaPart:
    """Count in a sequence or part of one that shares no identity with the others; equal to TrackEval's ``HOTA``."""
    truths, tracks, couples = len(sequence.truth_step), len(sequence.track_step), hota_couples(sequence)
    return HotaPart(truths, tracks, couples.matches.sum(axis=0), (couples.matches * couples.association).sum(axis=0))


def hota_couples(sequence: MotSequence) -> HotaCouples:
    """Count for each couple of identities."""
    if not len(sequence.pair_truth):
        none, nothing = np.zeros(0, dtype=np.int64), np.zeros((0, len(THRESHOLDS)))
        return HotaCouples(none, none, nothing, nothing)
    truth_count = np.bincount(sequence.truth_identity)
    track_count = np.bincount(sequence.track_identity)
    truth_identity = sequence.truth_identity[sequence.pair_truth]
    track_identity = sequence.track_identity[sequence.pair_track]
    couple, member = np.unique(truth_identity * len(track_count) + track_identity, return_inverse=True)
    longest = truth_count[couple // len(track_count)] + track_count[couple % len(track_count)]

    overlap = np.bincount(member, weights=_shared_similarity(sequence))
    alignment = overlap / (longest - overlap)
    chosen = best_assignment(sequence.pair_truth, sequence.pair_track, alignment[member] * sequence.pair_similarity)
    matches = _matches_by_threshold(sequence.pair_similarity[chosen], member[chosen], len(couple))
    association = matches / np.maximum(1.0, longest[:, None] - matches)
    return HotaCouples(couple // len(track_count), couple % len(track_count), matches, association)


def _shared_similarity(sequence: MotSequence) -> FloatArray:
    """Return each pair's similarity relative to all that its vehicle and its track share with others, shape (p,)."""
    truth_sum = np.bincount(sequence.pair_truth, weights=sequence.pair_similarity)[sequence.pair_truth]
    track_sum = np.bincount(sequence.pair_track, weights=sequence.pair_similarity)[sequence.pair_track]
    return sequence.pair_similarity / (truth_sum + track_sum - sequence.pair_similarity)


def _matches_by_threshold(similarity: FloatArray, couple: IntArray, couples: int) -> FloatArray:
    """Count the matches of each couple of identities that pass each threshold, shape (couples, thresholds)."""
    levels = len(THRESHOLDS) + 1
    passed = np.searchsorted(THRESHOLDS - np.finfo(float).eps, similarity, side="right")
    exactly = np.bincount(couple * levels + passed, minlength=couples * levels).reshape(couples, levels)
    return exactly[:, :0:-1].cumsum(axis=1)[:, ::-1].astype(np.float64)
