"""How much of the traffic the sensor and the tracker cover at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.scoring.history import DetectionHistory, first_of_group
from harness.scoring.matching import Matching
from harness.scoring.rows import RunRows
from harness.scoring.settings import TIME_TOLERANCE_S, ScoringSettings
from harness.sensor.observation import HIDDEN, VISIBLE
from mmpf.compute.arrays import FloatArray


@dataclass(frozen=True)
class Coverage:
    """Coverage of the vehicles that were ever in range.

    Attributes:
        vehicles_in_range: Vehicles that were in range at some step.
        detected: Those of them that were ever detected.
        never_detected: The others; they appear in no error.
        hidden_percent: Share of vehicle-steps in range that are hidden.
        prompt_vehicles: Vehicles whose record in range reaches ``prompt_s`` beyond their becoming visible.
        prompt_percent: Share of those that a track was matched to by then.
    """

    vehicles_in_range: int
    detected: int
    never_detected: int
    hidden_percent: float
    prompt_vehicles: int
    prompt_percent: float


@dataclass(frozen=True)
class DetectionNoise:
    """Mean absolute errors of the detections themselves, to hold the tracks' errors against."""

    lon_m: float
    lat_m: float
    n: int


def coverage(rows: RunRows, history: DetectionHistory, matching: Matching, settings: ScoringSettings) -> Coverage:
    """Count what was in range, what of it was detected, and how promptly visible vehicles got a track."""
    truth = rows.truth
    vehicles = int(truth.vehicle.max()) + 1 if len(truth) else 0
    in_range = np.bincount(truth.vehicle[truth.in_range], minlength=vehicles) > 0
    detected = np.bincount(truth.vehicle[history.last_row >= 0], minlength=vehicles) > 0
    hidden = truth.in_range & (truth.state == HIDDEN)

    visible = np.flatnonzero(truth.in_range & (truth.state == VISIBLE))
    first = visible[first_of_group(truth.vehicle[visible])]
    visible_from_s = np.full(vehicles, np.inf)
    visible_from_s[truth.vehicle[first]] = truth.time_s[first]
    deadline_s = visible_from_s + settings.prompt_s
    since_s = truth.time_s - visible_from_s[truth.vehicle]
    matched = (matching.track_row >= 0) & (since_s >= 0.0) & (since_s <= settings.prompt_s + TIME_TOLERANCE_S)
    prompt = np.bincount(truth.vehicle[matched], minlength=vehicles) > 0
    last_s = np.full(vehicles, -np.inf)
    np.maximum.at(last_s, truth.vehicle[truth.in_range], truth.time_s[truth.in_range])
    judged = last_s >= deadline_s - TIME_TOLERANCE_S
    return Coverage(
        vehicles_in_range=int(in_range.sum()),
        detected=int((in_range & detected).sum()),
        never_detected=int((in_range & ~detected).sum()),
        hidden_percent=_percent(hidden.sum(), truth.in_range.sum()),
        prompt_vehicles=int(judged.sum()),
        prompt_percent=_percent((judged & prompt).sum(), judged.sum()),
    )


def detection_noise(rows: RunRows) -> DetectionNoise:
    """Return the mean absolute errors of the detections that are not clutter; nan without any."""
    real = rows.detections.truth_row >= 0
    row = rows.detections.truth_row[real]
    lon_m = np.abs(rows.detections.lon_m[real] - rows.truth.lon_m[row])
    lat_m = np.abs(rows.detections.lat_m[real] - rows.truth.lat_m[row])
    return DetectionNoise(_mean(lon_m), _mean(lat_m), len(lon_m))


def _percent(part: np.integer | int, whole: np.integer | int) -> float:
    return 100.0 * float(part) / float(whole) if whole else np.nan


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else np.nan
