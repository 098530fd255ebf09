"""Multi-object scores: HOTA, CLEAR and identity scores of the vehicles in sight, and of all that are remembered."""

from __future__ import annotations

import numpy as np

from harness.scoring.clear import clear
from harness.scoring.evidence import Evidence
from harness.scoring.hota import hota
from harness.scoring.identity import identity
from harness.scoring.quantity import Quantity
from harness.scoring.sequence import MotSequence
from mmpf.compute.arrays import FloatArray

STEPS_A_MINUTE = 600.0
HOTA, IDF1, SWITCHES, TRUTH_N = "mot.hota", "mot.idf1", "mot.id_switches", "mot.truth_n"
IN_SIGHT = (
    Quantity(
        HOTA, "HOTA in sight, %", True,
        heading="HOTA %", compared=True, curve=True, ablated=True, reported=True,
    ),
    Quantity(HOTA, "HOTA in sight, %", True, weight=TRUTH_N, pooled="hota"),
    Quantity(IDF1, "IDF1 in sight, %", True, heading="IDF1 %", compared=True, ablated=True, reported=True),
    Quantity(IDF1, "IDF1 in sight, %", True, weight=TRUTH_N, pooled="idf1"),
    Quantity("mot.mota", "MOTA in sight, %", True, heading="MOTA %", reported=True),
    Quantity(SWITCHES, "identity switches a run", heading="switches", curve=True, ablated=True),
    Quantity(SWITCHES, "identity switches in sight", decimals=0, heading="switches", reported=True),
    Quantity(
        SWITCHES, "identity switches a vehicle-minute",
        decimals=3, weight=TRUTH_N, scale=STEPS_A_MINUTE, pooled="id_switches_per_vehicle_minute",
    ),
    Quantity("mot.missed", "vehicle-steps missed in sight", decimals=0, heading="missed", reported=True),
    Quantity("mot.false_tracks", "false track-steps in sight", decimals=0, heading="false", reported=True),
)  # fmt: skip
REMEMBERED = (
    Quantity("mot_all.hota", "HOTA last 10 s, %", higher_is_better=True, compared=True),
    Quantity("mot_all.idf1", "IDF1, seen within 10 s, %", higher_is_better=True, ablated=True),
    Quantity("mot_all.false_tracks_per_scan", "false tracks a scan, all", decimals=2, ablated=True),
)


def scores_in_sight(evidence: Evidence) -> dict[str, float]:
    """Return the scores over vehicles in sight; see ``multi_object_scores``."""
    return multi_object_scores(evidence.in_sight, evidence.rows.time_s)


def scores_remembered(evidence: Evidence) -> dict[str, float]:
    """Return the scores over vehicles detected within the memory; see ``multi_object_scores``."""
    return multi_object_scores(evidence.remembered, evidence.rows.time_s)


def multi_object_scores(sequence: MotSequence, time_s: FloatArray) -> dict[str, float]:
    """Score a sequence whose steps are at the given times, shape (steps,).

    Returns:
        ``hota`` with its halves ``deta`` and ``assa``, ``idf1`` and ``mota`` in percent, nan without truth;
        ``id_switches``, ``fragmentations`` (times that a vehicle's tracking stopped and went on, be it because the
        vehicle left the set), ``missed`` and ``false_tracks`` as counts of CLEAR, the last also per step; identity
        switches per minute of a vehicle in the set; vehicle-steps ``truth_n`` and track-steps ``tracks_n``.
    """
    truths, tracks = len(sequence.truth_step), len(sequence.track_step)
    percent = 100.0 if truths else np.nan
    accuracy = hota(sequence)
    events = clear(sequence)
    step_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else np.nan
    return {
        "hota": percent * accuracy.hota,
        "deta": percent * accuracy.deta,
        "assa": percent * accuracy.assa,
        "idf1": percent * identity(sequence),
        "mota": percent * events.mota,
        "id_switches": events.id_switches,
        "fragmentations": events.fragmentations,
        "missed": events.missed,
        "false_tracks": events.false_tracks,
        "false_tracks_per_scan": events.false_tracks / len(time_s) if len(time_s) else np.nan,
        "id_switches_per_vehicle_minute": events.id_switches / (truths * step_s / 60.0) if truths else np.nan,
        "truth_n": truths,
        "tracks_n": tracks,
    }
