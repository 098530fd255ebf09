"""Identity scores: one track for each vehicle over the whole sequence (Ristani et al. 2016)."""

from __future__ import annotations

import numpy as np

from harness.scoring.evidence.assignment import best_assignment
from harness.scoring.evidence.pairs import GATE_SIMILARITY
from harness.scoring.evidence.sequence import MotSequence


def idf1(matched: int, rows: int) -> float:
    """Return IDF1 of the counts of ``measure_identity``, or of their sums over parts without a common identity."""
    return 2.0 * matched / rows if matched else 0.0


def measure_identity(sequence: MotSequence) -> tuple[int, int]:
    """Return how many truth rows have the right track, and how many rows of either kind there are."""
    rows = len(sequence.truth_step) + len(sequence.track_step)
    gated = sequence.pair_similarity >= GATE_SIMILARITY
    if not gated.any():
        return 0, rows
    truth = sequence.truth_identity[sequence.pair_truth[gated]]
    track = sequence.track_identity[sequence.pair_track[gated]]
    span = int(track.max()) + 1
    couple, count = np.unique(truth * span + track, return_counts=True)
    chosen = best_assignment(couple // span, couple % span, count.astype(np.float64))
    return int(count[chosen].sum()), rows
