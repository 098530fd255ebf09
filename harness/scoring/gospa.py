"""GOSPA: distance between the set of vehicles and the set of tracks (Rahmathullah, Garcia-Fernandez, Svensson 2017)."""

from __future__ import annotations

import numpy as np

from harness.scoring.assignment import best_assignment
from harness.scoring.evidence import Evidence
from harness.scoring.quantity import Quantity
from harness.scoring.sequence import MotSequence

QUANTITIES = (Quantity("gospa.mean", "GOSPA, m", compared=True),)


def gospa_in_sight(evidence: Evidence) -> dict[str, float]:
    """Return the scores over vehicles in sight; see ``gospa``."""
    return gospa(evidence.in_sight, evidence.settings.gospa_cutoff_m, evidence.settings.gospa_order)


def gospa(sequence: MotSequence, cutoff_m: float, order: float) -> dict[str, float]:
    """Score the sets of positions step by step, in the form of the reference's Proposition 1 (alpha = 2).

    Args:
        sequence: Truth and tracks; all pairs nearer than the cut-off must be among its pairs.
        cutoff_m: Distance c from which a vehicle and a track have nothing to do with each other.
        order: Order p.

    Returns:
        Means over steps, nan without one: ``mean`` of the metric; ``localisation`` of the assigned pairs' summed
        distances to the power of the order, ``missed`` and ``false`` of ``c^p / 2`` for each vehicle without a track
        and each track without a vehicle. For order 1 all are metres, and the three parts add up to the mean.
    """
    steps = sequence.steps
    if steps == 0:
        return dict.fromkeys(("mean", "localisation", "missed", "false"), np.nan)
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
    parts = {"mean": total, "localisation": localisation, "missed": missed, "false": false}
    return {name: float(part.mean()) for name, part in parts.items()}
