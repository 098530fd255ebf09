"""GOSPA: distance between the set of vehicles and the set of tracks (Rahmathullah, Garcia-Fernandez, Svensson 2017)."""

from __future__ import annotations

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
CUTOFF_M, ORDER = 4.0, 1.0
"""Distance c from which vehicle and track count as missed and false, and order p, of vehicles in sight."""
PARTS = ("mean", "localisation", "missed", "false")


def measure_in_sight(evidence: Evidence) -> FloatArray:
    """Return localisation, missed and false of vehicles in sight at each step, shape (3, steps); see ``gospa``."""
    return _parts(evidence.in_sight, CUTOFF_M, ORDER)


def measure_remembered(evidence: Evidence) -> FloatArray:
    """Return localisation, missed and false of all vehicles once seen at each step, shape (3, steps).

    The cut-off is that of ``following``, so that a hidden vehicle's track may be metres off; the order is 1.
    """
    following, rows = evidence.following, evidence.rows
    truth_step, track_step, steps = rows.truth.step, rows.tracks.step, len(rows.time_s)
    followed = following.counted & (following.track_row >= 0)
    half = 0.5 * FOLLOW_CUTOFF_M
    localisation = np.bincount(truth_step[followed], weights=following.distance_m[followed], minlength=steps)
    missed = half * np.bincount(truth_step[following.counted & ~followed], minlength=steps)
    false = half * np.bincount(track_step[following.idle], minlength=steps)
    return np.array([localisation, missed, false], dtype=np.float64)


def gospa_of_steps(parts: Sequence[FloatArray], _: np.random.Generator) -> dict[str, float]:
    """Return the scores over vehicles in sight, or over all once seen and all reported tracks; see ``gospa``."""
    return _means(joined(parts, axis=1), ORDER)


def gospa(sequence: MotSequence, cutoff_m: float, order: float) -> dict[str, float]:
    """Score the sets of positions step by step, in the form of the reference's Proposition 1 (alpha = 2).

    All pairs nearer than the cut-off c must be among the sequence's pairs.

    Returns:
        Means over steps, nan without one: ``mean`` of the metric; ``localisation`` of the assigned pairs' summed
        distances to the power of the order p, ``missed`` and ``false`` of ``c^p / 2`` for each vehicle without a track
        and each track without a vehicle. For order 1 all are metres, and the three parts add up to the mean.
    """
    return _means(_parts(sequence, cutoff_m, order), order)


def _parts(sequence: MotSequence, cutoff_m: float, order: float) -> FloatArray:
    """Return localisation, missed and false at each step, shape (3, steps)."""
    steps = sequence.steps
    distance_m = sequence.pair_distance_m
    near = np.flatnonzero(distance_m < cutoff_m)
    gain = cutoff_m**order - distance_m[near] ** order
    chosen = near[best_assignment(sequence.pair_truth[near], sequence.pair_track[near], gain)]
    step = sequence.truth_step[sequence.pair_truth[chosen]]
    localisation = np.bincount(step, weights=distance_m[chosen] ** order, minlength=steps)
    assigned = np.bincount(step, minlength=steps)
    half = 0.5 * cutoff_m**order
    missed = half * (np.bincount(sequence.truth_step, minlength=steps) - assigned)
    false = half * (np.bincount(sequence.track_step, minlength=steps) - assigned)
    return np.array([localisation, missed, false], dtype=np.float64)


def _means(parts: FloatArray, order: float) -> dict[str, float]:
    """Return the means over steps of the metric and of its parts, shape (3, steps)."""
    whole = np.vstack([parts.sum(axis=0) ** (1.0 / order), parts])
    means = whole.mean(axis=1) if whole.shape[1] else np.full(len(PARTS), np.nan)
    return dict(zip(PARTS, means.tolist(), strict=True))
