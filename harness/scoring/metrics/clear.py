"""CLEAR MOT: misses, false tracks, identity switches, fragmentations (Bernardin & Stiefelhagen 2008)."""

from dataclasses import dataclass

import numpy as np

from harness.scoring.evidence.assignment import components, solve_dense, unrivalled
from harness.scoring.evidence.pairs import GATE_SIMILARITY
from harness.scoring.evidence.sequence import MotSequence
from mmpf.numerics.arrays import IntArray

CONTINUITY_BONUS = 1000.0
"""Gain of keeping the last step's match, far above any similarity."""


@dataclass(frozen=True)
class ClearScores:
    """CLEAR scores of a sequence: rows with and without a partner, switches of identity and fragmentations.

    An ``id_switch`` is a match to another track than the vehicle's last one, however long ago that was; a fragmentation
    is when its tracking stopped and went on, be it because the vehicle was absent.
    """

    matches: int
    missed: int
    false_tracks: int
    id_switches: int
    fragmentations: int

    @property
    def mota(self) -> float:
        """``(matches - false_tracks - id_switches) / truth rows``, at most 1; 0 without truth or without tracks."""
        truths, tracks = self.matches + self.missed, self.matches + self.false_tracks
        return (self.matches - self.false_tracks - self.id_switches) / truths if truths and tracks else 0.0


def clear(sequence: MotSequence) -> ClearScores:
    """Score a sequence by matches of at least ``GATE_SIMILARITY``, equal to TrackEval's ``CLEAR``."""
    truths, tracks = len(sequence.truth_step), len(sequence.track_step)
    scan = _scan_numbers(sequence)
    found = clear_matches(sequence)
    again = np.diff(sequence.truth_identity[found.truth]) == 0
    switches = len(found.switches(sequence))
    fragmentations = int((again & (np.diff(scan[found.truth]) > 1)).sum())
    matches = len(found.truth)
    return ClearScores(matches, truths - matches, tracks - matches, switches, fragmentations)


@dataclass(frozen=True)
class ClearMatches:
    """Rows of the matches of CLEAR, each vehicle's in the order of time, vehicle after vehicle, shape (matches,)."""

    truth: IntArray
    track: IntArray

    def switches(self, sequence: MotSequence) -> IntArray:
        """Return the matches that are to another track than the vehicle's match before, shape (switches,)."""
        again = np.diff(sequence.truth_identity[self.truth]) == 0
        return np.flatnonzero(again & (np.diff(sequence.track_identity[self.track]) != 0)) + 1


def clear_matches(sequence: MotSequence) -> ClearMatches:
    """Match a sequence as CLEAR does."""
    order = np.lexsort((sequence.truth_step, sequence.truth_identity))
    track_row = _match(sequence, _row_one_scan_before(sequence, _scan_numbers(sequence), order))[order]
    return ClearMatches(order[track_row >= 0], track_row[track_row >= 0])


def _scan_numbers(sequence: MotSequence) -> IntArray:
    """Number each truth row's step among those with both truth and tracks; -1 at the others, which break nothing."""
    has_truth = np.bincount(sequence.truth_step, minlength=sequence.steps) > 0
    has_track = np.bincount(sequence.track_step, minlength=sequence.steps) > 0
    both = has_truth & has_track
    return np.where(both, np.cumsum(both) - 1, -1)[sequence.truth_step]


def _row_one_scan_before(sequence: MotSequence, scan: IntArray, order: IntArray) -> IntArray:
    """Return the row of the same identity in the scan before, or -1, shape (n,); order sorts by identity and step."""
    before = np.full(len(order), -1)
    rows = order[scan[order] >= 0]
    follows = (np.diff(sequence.truth_identity[rows]) == 0) & (np.diff(scan[rows]) == 1)
    before[rows[1:][follows]] = rows[:-1][follows]
    return before


def _match(sequence: MotSequence, row_before: IntArray) -> IntArray:
    """Match scan by scan, keeping a vehicle's match of the scan before where it may; return track rows, shape (n,).

    Pairs without a rival are matched whatever happened before, so only the contested ones are gone through in order.
    """
    gated = np.flatnonzero(sequence.pair_similarity >= GATE_SIMILARITY - np.finfo(float).eps)
    truth, track = sequence.pair_truth[gated], sequence.pair_track[gated]
    similarity = sequence.pair_similarity[gated]
    track_row = np.full(len(sequence.truth_step), -1)
    alone = unrivalled(truth, track)
    track_row[truth[alone]] = track[alone]
    contested = np.flatnonzero(~alone)
    if not len(contested):
        return track_row
    label = components(truth[contested], track[contested])
    order = np.lexsort((label, sequence.truth_step[truth[contested]]))
    contested, label = contested[order], label[order]
    for pairs in np.split(contested, np.flatnonzero(np.diff(label)) + 1):
        before = row_before[truth[pairs]]
        last = np.where(before >= 0, track_row[before], -1)
        kept = (last >= 0) & (sequence.track_identity[last] == sequence.track_identity[track[pairs]])
        chosen = pairs[solve_dense(truth[pairs], track[pairs], CONTINUITY_BONUS * kept + similarity[pairs])]
        track_row[truth[chosen]] = track[chosen]
    return track_row
