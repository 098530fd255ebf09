"""HOTA, CLEAR and identity scores of vehicles in sight, and of all known vehicles."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from harness.scoring.evidence.assignment import best_assignment
from harness.scoring.evidence.pairs import GATE_SIMILARITY
from harness.scoring.evidence.plain_view import durations
from harness.scoring.evidence.rows import RunRows
from harness.scoring.evidence.sequence import MotSequence
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.clear import ClearScores, clear
from harness.scoring.metrics.hota import HotaPart, measure_hota
from harness.scoring.metrics.parts import of_whole, ratio
from harness.scoring.metrics.quantity import STEPS, Columns, Quantity
from mmpf.numerics.arrays import FloatArray


def rows_of_runs(column: Columns, table: str) -> tuple[FloatArray, FloatArray]:
    """Return what IDF1 is a share of: each run's rows with the right identity and all rows, both of shape (runs,)."""
    rows = column(f"{table}.truth_n") + column(f"{table}.tracks_n")
    return column(f"{table}.idf1") * rows, rows


HOTA, IDF1, SWITCHES, TRUTH_N = "mot.hota", "mot.idf1", "mot.id_switches", "mot.truth_n"
IN_SIGHT = (
    Quantity(HOTA, "HOTA in sight, %", True, heading="HOTA %"),
    Quantity(
        IDF1, "IDF1 in sight, %", True, heading="IDF1 %", weight=TRUTH_N, pooled=partial(rows_of_runs, table="mot")
    ),
    Quantity("mot.mota", "MOTA in sight, %", True, heading="MOTA %", weight=TRUTH_N, least=-np.inf),
    Quantity(
        SWITCHES, "identity switches a vehicle-minute",
        decimals=3, heading="switches", weight="mot.truth_s", scale=60.0, is_counted=True,
    ),
    Quantity("mot.missed", "vehicle-steps missed in sight", decimals=0, heading="missed"),
    Quantity("mot.false_tracks", "false track-steps in sight", decimals=0, heading="false"),
)  # fmt: skip
REMEMBERED = (
    Quantity("mot_all.hota", "HOTA last 10 s, %", higher_is_better=True),
    Quantity(
        "mot_all.idf1",
        "IDF1, seen within 10 s, %",
        True,
        weight="mot_all.truth_n",
        pooled=partial(rows_of_runs, table="mot_all"),
    ),
    Quantity("mot_all.false_tracks_per_scan", "false tracks a scan, all", decimals=2, weight=STEPS),
)


@dataclass(frozen=True)
class MotPart:
    """What the scores count in a stretch of ``steps`` steps; its vehicle-steps stand for ``truth_s`` seconds."""

    accuracy: HotaPart
    events: ClearScores
    identity: tuple[int, int]
    steps: int
    truth_s: float


def measure_in_sight(evidence: Evidence) -> MotPart:
    """Count over the vehicles of a stretch that are in sight."""
    return measure_sequence(evidence.in_sight, evidence.rows)


def measure_remembered(evidence: Evidence) -> MotPart:
    """Count over the vehicles of a stretch that were detected within the memory."""
    return measure_sequence(evidence.remembered, evidence.rows)


def measure_sequence(sequence: MotSequence, rows: RunRows) -> MotPart:
    """Count in a sequence of a stretch's rows."""
    truth_s = float(durations(rows.time_s, rows.episode)[sequence.truth_step].sum())
    return MotPart(measure_hota(sequence), clear(sequence), measure_identity(sequence), sequence.steps, truth_s)


@of_whole
def multi_object_scores(part: MotPart) -> dict[str, float]:
    """Score stretches that share no identity.

    Returns:
        ``hota`` with its halves ``deta`` and ``assa``, ``idf1`` and ``mota`` in percent, nan without truth;
        ``id_switches``, ``fragmentations`` (times that a vehicle's tracking stopped and went on, be it because the
        vehicle left the set), ``missed`` and ``false_tracks`` as counts of CLEAR, the last also per step; identity
        switches per minute of a vehicle in the set; vehicle-steps ``truth_n``, which stand for ``truth_s`` seconds,
        and track-steps ``tracks_n``. Several runs have the mean of their ``hota``, which is no ratio of counts.
    """
    truths, events = part.accuracy.truths, part.events
    percent = 100.0 if truths else np.nan
    accuracy = part.accuracy.scores()
    return {
        "hota": percent * accuracy.hota,
        "deta": percent * accuracy.deta,
        "assa": percent * accuracy.assa,
        "idf1": percent * idf1(*part.identity),
        "mota": percent * events.mota,
        "id_switches": events.id_switches,
        "fragmentations": events.fragmentations,
        "missed": events.missed,
        "false_tracks": events.false_tracks,
        "false_tracks_per_scan": ratio(events.false_tracks, part.steps),
        "id_switches_per_vehicle_minute": ratio(60.0 * events.id_switches, part.truth_s),
        "truth_n": truths,
        "truth_s": part.truth_s,
        "tracks_n": part.accuracy.tracks,
    }


def idf1(matched: int, rows: int) -> float:
    """Return IDF1 of the counts of ``measure_identity``, or of their sums over parts without a common identity."""
    return 2.0 * matched / rows if matched else 0.0


def measure_identity(sequence: MotSequence) -> tuple[int, int]:
    """Return how many truth rows have the right track, and how many rows of either kind there are.

    One track counts for each vehicle over the whole sequence (Ristani et al. 2016).
    """
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
