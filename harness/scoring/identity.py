"""Identity scores: one track for each vehicle over the whole sequence (Ristani et al. 2016)."""

from __future__ import annotations

import numpy as np

from harness.scoring.assignment import best_assignment
from harness.scoring.pairs import GATE_SIMILARITY
from harness.scoring.sequence import MotSequence


def identity(sequence: MotSequence, threshold: float = GATE_SIMILARITY) -> float:
    """Return IDF1, in [0, 1], equal to TrackEval's; 0 without truth or without tracks.

    Args:
        sequence: Truth and tracks.
        threshold: Least similarity of rows that may count as right.
    """
    rows = len(sequence.truth_step) + len(sequence.track_step)
    gated = sequence.pair_similarity >= threshold
    if not gated.any():
        return 0.0
    truth = sequence.truth_identity[sequence.pair_truth[gated]]
    track = sequence.track_identity[sequence.pair_track[gated]]
    span = int(track.max()) + 1
    couple, count = np.unique(truth * span + track, return_counts=True)
    chosen = best_assignment(couple // span, couple % span, count.astype(np.float64))
    return 2.0 * int(count[chosen].sum()) / rows
