"""GOSPA: distance between the set of vehicles and the set of tracks (Rahmathullah, Garcia-Fernandez, Svensson 2017)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.scoring.assignment import best_assignment
from harness.scoring.sequence import MotSequence


@dataclass(frozen=True)
class GospaScores:
    """GOSPA with alpha = 2, averaged over steps; in metres for order 1, where the three parts add up to the mean.

    Attributes:
        mean: Mean of the metric.
        localisation: Mean of the assigned pairs' summed distances to the power of the order.
        missed: Mean of ``c^p / 2`` for each vehicle without a track.
        false: Mean of ``c^p / 2`` for each track without a vehicle.
    """

    mean: float
    localisation: float
    missed: float
    false: float


def gospa(sequence: MotSequence, cutoff_m: float, order: float) -> GospaScores:
    """Score the sets of positions step by step, in the form of the reference's Proposition 1 (alpha = 2).

    Args:
        sequence: Truth and tracks; all pairs nearer than the cut-off must be among its pairs.
        cutoff_m: Distance c from which a vehicle and a track have nothing to do with each other.
        order: Order p.

    Returns:
        The means over steps; nan without a step.
    """
    steps = sequence.steps
    if steps == 0:
        return GospaScores(np.nan, np.nan, np.nan, np.nan)
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
    total = (localisation + missed + false) ** (1.0 / order)
    return GospaScores(float(total.mean()), float(localisation.mean()), float(missed.mean()), float(false.mean()))
