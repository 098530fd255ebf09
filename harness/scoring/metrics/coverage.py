"""What share of the traffic the sensor and the tracker cover."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.scoring.evidence.directions import along_and_across
from harness.scoring.evidence.history import first_of_group
from harness.scoring.evidence.settings import TIME_TOLERANCE_S
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import Basis
from harness.storage.schema import HIDDEN, VISIBLE


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
    return CoveragePart(
        in_range=int(in_range.sum()),
        detected=int((in_range & detected).sum()),
        hidden_steps=int(hidden.sum()),
        in_range_steps=int(truth.in_range.sum()),
        judged=int(judged.sum()),
        prompt=int((judged & prompt).sum()),
    )


def coverage(parts: Sequence[CoveragePart], basis: Basis) -> dict[str, float]:  # noqa: ARG001
    """Return what was in range, what of it was detected, and how promptly visible vehicles got a track.

    Returns:
        ``vehicles_in_range``: vehicles that were in range at some step; those of them that were ever ``detected``, and
        the others, ``never_detected``, which appear in no error; ``hidden_percent`` of vehicle-steps in range;
        ``prompt_vehicles``: vehicles whose record in range reaches ``prompt_s`` beyond their becoming visible, and
        ``prompt_percent`` of them that a track was matched to by then.
    """
    in_range, detected = sum(part.in_range for part in parts), sum(part.detected for part in parts)
    judged = sum(part.judged for part in parts)
    return {
        "vehicles_in_range": in_range,
        "detected": detected,
        "never_detected": in_range - detected,
        "hidden_percent": _percent(
            sum(part.hidden_steps for part in parts), sum(part.in_range_steps for part in parts)
        ),
        "prompt_vehicles": judged,
        "prompt_percent": _percent(sum(part.prompt for part in parts), judged),
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


def detection_noise(parts: Sequence[NoisePart], basis: Basis) -> dict[str, float]:  # noqa: ARG001
    """Return the mean absolute errors of the detections that are not clutter, to hold the tracks' against; or nan."""
    n = sum(part.n for part in parts)
    lon_m, lat_m = sum(part.lon_m for part in parts), sum(part.lat_m for part in parts)
    return {"lon_m": lon_m / n if n else np.nan, "lat_m": lat_m / n if n else np.nan, "n": n}


def _percent(part: int, whole: int) -> float:
    return 100.0 * float(part) / float(whole) if whole else np.nan
