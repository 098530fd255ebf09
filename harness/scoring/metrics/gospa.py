"""GOSPA: distance between the set of vehicles and the set of tracks (Rahmathullah, Garcia-Fernandez, Svensson 2017)."""

from collections.abc import Sequence

import numpy as np

from harness.scoring.evidence.assignment import best_assignment
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M
from harness.scoring.evidence.sequence import MotSequence
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import joined
from harness.scoring.metrics.quantity import STEPS, Quantity
from mmpf.numerics.arrays import FloatArray

IN_SIGHT = (Quantity("gospa.mean", "GOSPA in sight, m", weight=STEPS),)
REMEMBERED = (
    Quantity("gospa_remembered.mean", "GOSPA remembered, m", weight=STEPS),
    Quantity("gospa_remembered.localisation", "GOSPA remembered: localisation, m", weight=STEPS),
    Quantity("gospa_remembered.missed", "GOSPA remembered: missed, m", weight=STEPS),
    Quantity("gospa_remembered.false", "GOSPA remembered: false, m", weight=STEPS),
)
CUTOFF_M = 4.0
"""Distance from which vehicle and track count as missed and false, of vehicles in sight."""
PARTS = ("mean", "localisation", "missed", "false")


def measure_in_sight(evidence: Evidence) -> FloatArray:
    """Return localisation, missed and false of vehicles in sight at each step, shape (3, steps)."""
    return distances(evidence.in_sight)


def measure_remembered(evidence: Evidence) -> FloatArray:
    """Return localisation, missed and false of all vehicles once seen at each step, shape (3, steps).

    The cut-off is that of ``following``, so that a hidden vehicle's track may be metres off.
    """
    following, rows = evidence.following, evidence.rows
    truth_step, track_step, steps = rows.truth.step, rows.tracks.step, len(rows.time_s)
    followed = following.counted & (following.track_row >= 0)
    half = 0.5 * FOLLOW_CUTOFF_M
    localisation = np.bincount(truth_step[followed], weights=following.distance_m[followed], minlength=steps)
    missed = half * np.bincount(truth_step[following.counted & ~followed], minlength=steps)
    false = half * np.bincount(track_step[following.idle], minlength=steps)
    return np.array([localisation, missed, false], dtype=np.float64)


def distances(sequence: MotSequence) -> FloatArray:
    """Return localisation, missed and false at each step, shape (3, steps).

    All pairs nearer than the cut-off must be among the sequence's pairs.
    """
    steps, half = sequence.steps, 0.5 * CUTOFF_M
    near = np.flatnonzero(sequence.pair_distance_m < CUTOFF_M)
    gain = CUTOFF_M - sequence.pair_distance_m[near]
    chosen = near[best_assignment(sequence.pair_truth[near], sequence.pair_track[near], gain)]
    step = sequence.truth_step[sequence.pair_truth[chosen]]
    localisation = np.bincount(step, weights=sequence.pair_distance_m[chosen], minlength=steps)
    assigned = np.bincount(step, minlength=steps)
    missed = half * (np.bincount(sequence.truth_step, minlength=steps) - assigned)
    false = half * (np.bincount(sequence.track_step, minlength=steps) - assigned)
    return np.array([localisation, missed, false], dtype=np.float64)


def gospa_of_steps(parts: Sequence[FloatArray], _: np.random.Generator) -> dict[str, float]:
    """Return the scores over vehicles in sight, or over all once seen and all reported tracks.

    The sets of positions are compared step by step, as in Proposition 1 of Rahmathullah, Garcia-Fernandez and Svensson
    (2017), with alpha 2 and the order 1.

    Returns:
        Means over steps in metres, nan without one: ``localisation`` of the assigned pairs' summed distances,
        ``missed`` and ``false`` of half the cut-off (4 m in sight, else 10 m) for each vehicle without a track and each
        track without a vehicle, and ``mean`` of the metric, to which the three add up.
    """
    of_steps = joined(parts, axis=1)
    whole = np.vstack([of_steps.sum(axis=0), of_steps])
    means = whole.mean(axis=1) if whole.shape[1] else np.full(len(PARTS), np.nan)
    return dict(zip(PARTS, means.tolist(), strict=True))
