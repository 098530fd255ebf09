"""How much of the traffic the sensor and the tracker cover at all."""

from __future__ import annotations

import numpy as np

from harness.scoring.evidence import Evidence
from harness.scoring.history import first_of_group
from harness.scoring.settings import TIME_TOLERANCE_S
from harness.sensor.observation import HIDDEN, VISIBLE
from mmpf.compute.arrays import FloatArray


def coverage(evidence: Evidence) -> dict[str, float]:
    """Count what was in range, what of it was detected, and how promptly visible vehicles got a track.

    Returns:
        ``vehicles_in_range``: vehicles that were in range at some step; those of them that were ever ``detected``, and
        the others, ``never_detected``, which appear in no error; ``hidden_percent`` of vehicle-steps in range;
        ``prompt_vehicles``: vehicles whose record in range reaches ``prompt_s`` beyond their becoming visible, and
        ``prompt_percent`` of them that a track was matched to by then.
    """
    truth, settings = evidence.rows.truth, evidence.settings
    vehicles = int(truth.vehicle.max()) + 1 if len(truth) else 0
    in_range = np.bincount(truth.vehicle[truth.in_range], minlength=vehicles) > 0
    detected = np.bincount(truth.vehicle[evidence.history.last_row >= 0], minlength=vehicles) > 0
    hidden = truth.in_range & (truth.state == HIDDEN)

    visible = np.flatnonzero(truth.in_range & (truth.state == VISIBLE))
    first = visible[first_of_group(truth.vehicle[visible])]
    visible_from_s = np.full(vehicles, np.inf)
    visible_from_s[truth.vehicle[first]] = truth.time_s[first]
    deadline_s = visible_from_s + settings.prompt_s
    since_s = truth.time_s - visible_from_s[truth.vehicle]
    matched = (evidence.matching.track_row >= 0) & (since_s >= 0.0) & (since_s <= settings.prompt_s + TIME_TOLERANCE_S)
    prompt = np.bincount(truth.vehicle[matched], minlength=vehicles) > 0
    last_s = np.full(vehicles, -np.inf)
    np.maximum.at(last_s, truth.vehicle[truth.in_range], truth.time_s[truth.in_range])
    judged = last_s >= deadline_s - TIME_TOLERANCE_S
    return {
        "vehicles_in_range": int(in_range.sum()),
        "detected": int((in_range & detected).sum()),
        "never_detected": int((in_range & ~detected).sum()),
        "hidden_percent": _percent(hidden.sum(), truth.in_range.sum()),
        "prompt_vehicles": int(judged.sum()),
        "prompt_percent": _percent((judged & prompt).sum(), judged.sum()),
    }


def detection_noise(evidence: Evidence) -> dict[str, float]:
    """Return the mean absolute errors of the detections that are not clutter, to hold the tracks' against; or nan."""
    rows = evidence.rows
    real = rows.detections.truth_row >= 0
    row = rows.detections.truth_row[real]
    lon_m = np.abs(rows.detections.lon_m[real] - rows.truth.lon_m[row])
    lat_m = np.abs(rows.detections.lat_m[real] - rows.truth.lat_m[row])
    return {"lon_m": _mean(lon_m), "lat_m": _mean(lat_m), "n": len(lon_m)}


def _percent(part: np.integer | int, whole: np.integer | int) -> float:
    return 100.0 * float(part) / float(whole) if whole else np.nan


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else np.nan
