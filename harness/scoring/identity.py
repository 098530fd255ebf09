"""Identity scores: one track for each vehicle over the whole sequence (Ristani et al. 2016)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.scoring.assignment import best_assignment
from harness.scoring.pairs import GATE_SIMILARITY
from harness.scoring.sequence import MotSequence


@dataclass(frozen=True)
class IdentityScores:
    """Identity scores of a sequence.

    Attributes:
        idf1: F1 score of rows with the right identity, in [0, 1]; 0 without truth or without tracks.
        right: Truth rows whose track is the one assigned to the vehicle for the whole sequence.
    """

    idf1: float
    right: int


def identity(sequence: MotSequence, threshold: float = GATE_SIMILARITY) -> IdentityScores:
    """Score a sequence, equal to TrackEval's ``Identity``.

    Args:
        sequence: Truth and tracks.
        threshold: Least similarity of rows that may count as right.

    Returns:
        The scores.
    """
    rows = len(sequence.truth_step) + len(sequence.track_step)
    gated = sequence.pair_similarity >= threshold
    if not gated.any():
        return IdentityScores(0.0, 0)
    truth = sequence.truth_identity[sequence.pair_truth[gated]]
    track = sequence.track_identity[sequence.pair_track[gated]]
    span = int(track.max()) + 1
    couple, count = np.unique(truth * span + track, return_counts=True)
    chosen = best_assignment(couple // span, couple % span, count.astype(np.float64))
    right = int(count[chosen].sum())
    return IdentityScores(2.0 * right / rows, right)
