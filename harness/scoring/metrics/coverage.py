"""What share of the traffic the sensor and the tracker cover."""

from dataclasses import dataclass

import numpy as np

from harness.scoring.evidence.directions import along_and_across
from harness.scoring.evidence.history import first_of_group
from harness.scoring.evidence.rules import TIME_TOLERANCE_S
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import of_whole, ratio
from harness.storage.schema import HIDDEN, VISIBLE

PROMPT_S = 0.5
"""A vehicle that becomes visible should have a track after this time."""


@dataclass(frozen=True)
class CoveragePart:
    """Counts of a stretch: vehicles, vehicle-steps (those named so), and vehicles with a track in time."""

    in_range: int
    detected: int
    hidden_steps: int
    in_range_steps: int
    judged: int
    prompt: int


def measure_coverage(evidence: Evidence) -> CoveragePart:
    """Count in a stretch."""
    truth = evidence.rows.truth
    vehicles = int(truth.vehicle.max()) + 1 if len(truth) else 0
    in_range = np.bincount(truth.vehicle[truth.in_range], minlength=vehicles) > 0
    detected = np.bincount(truth.vehicle[evidence.history.last_row >= 0], minlength=vehicles) > 0
    hidden = truth.in_range & (truth.state == HIDDEN)

    visible = np.flatnonzero(truth.in_range & (truth.state == VISIBLE))
    first = visible[first_of_group(truth.vehicle[visible])]
    visible_from_s = np.full(vehicles, np.inf)
    visible_from_s[truth.vehicle[first]] = truth.time_s[first]
    deadline_s = visible_from_s + PROMPT_S
    since_s = truth.time_s - visible_from_s[truth.vehicle]
    matched = (evidence.matching.track_row >= 0) & (since_s >= 0.0) & (since_s <= PROMPT_S + TIME_TOLERANCE_S)
    prompt = np.bincount(truth.vehicle[matched], minlength=vehicles) > 0
    last_s = np.full(vehicles, -np.inf)
    np.maximum.at(last_s, truth.vehicle[truth.in_range], truth.time_s[truth.in_range])
    judged = last_s >= deadline_s - TIME_TOLERANCE_S
    return CoveragePart(
        in_range=int(in_range.sum()),
        detected=int((in_range & detected).sum()),
        hidden_steps=int(hidden.sum()),
        in_range_steps=int(truth.in_range.sum()),
        judged=int(judged.sum()),
        prompt=int((judged & prompt).sum()),
    )


@of_whole
def coverage(part: CoveragePart) -> dict[str, float]:
    """Return what was in range, what of it was detected, and how promptly visible vehicles got a track.

    Returns:
        ``vehicles_in_range``: vehicles that were in range at some step; those of them that were ever ``detected``, and
        the others, ``never_detected``, which appear in no error; ``hidden_percent`` of vehicle-steps in range;
        ``prompt_vehicles``: vehicles whose record in range reaches half a second beyond their becoming visible, and
        ``prompt_percent`` of them that a track was matched to by then.
    """
    return {
        "vehicles_in_range": part.in_range,
        "detected": part.detected,
        "never_detected": part.in_range - part.detected,
        "hidden_percent": ratio(100.0 * part.hidden_steps, part.in_range_steps),
        "prompt_vehicles": part.judged,
        "prompt_percent": ratio(100.0 * part.prompt, part.judged),
    }


@dataclass(frozen=True)
class NoisePart:
    """Sums of the absolute errors of a stretch's ``n`` detections that are not clutter."""

    lon_m: float
    lat_m: float
    n: int


def measure_detection_noise(evidence: Evidence) -> NoisePart:
    """Sum over a stretch."""
    rows = evidence.rows
    real = rows.detections.truth_row >= 0
    row = rows.detections.truth_row[real]
    lon_m, lat_m = along_and_across(
        rows.detections.lon_m[real] - rows.truth.lon_m[row],
        rows.detections.lat_m[real] - rows.truth.lat_m[row],
        rows.truth.direction_rad[row],
    )
    return NoisePart(float(np.abs(lon_m).sum()), float(np.abs(lat_m).sum()), len(lon_m))


@of_whole
def detection_noise(part: NoisePart) -> dict[str, float]:
    """Return the mean absolute errors of the detections that are not clutter, to hold the tracks' against; or nan."""
    return {"lon_m": ratio(part.lon_m, part.n), "lat_m": ratio(part.lat_m, part.n), "n": part.n}
