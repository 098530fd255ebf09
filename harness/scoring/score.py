"""The score of a run: every metric from its three tables.

Conventions of all scores: the ego is no vehicle; tentative tracks are not reported and not scored; accuracies and
shares are in percent; errors are estimate minus truth; vehicles and tracks of different episodes have nothing to do
with each other; a vehicle beyond the sensor's range is neither missed nor is the track on it false, and the same holds
at and beyond the edge of the road that the truth's source knows. What has no rows
behind it is nan here and null in ``metrics.json``.

The error of a hidden vehicle counts only while its track is alive and its own, so a tracker that soon lets go of hidden
vehicles has small errors over few rows: read it beside ``hidden_outcomes``, or compare trackers on the rows that both
follow (``harness.scoring.paired``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
import pandas as pd

from harness.scoring.calibration import Calibration, calibration
from harness.scoring.clear import clear
from harness.scoring.coverage import Coverage, DetectionNoise, coverage, detection_noise
from harness.scoring.errors import error_table
from harness.scoring.gospa import GospaScores, gospa
from harness.scoring.history import detection_history
from harness.scoring.hota import hota
from harness.scoring.identity import identity
from harness.scoring.mae import (
    HiddenBin,
    HiddenOutcomes,
    MeanErrors,
    error_arrays,
    errors_by_state,
    errors_by_time_hidden,
    hidden_outcomes,
)
from harness.scoring.matching import match
from harness.scoring.occlusion import OcclusionCounts, count_outcomes, event_table, occlusion_events
from harness.scoring.pairs import near_pairs
from harness.scoring.rows import read_run
from harness.scoring.sequence import MotSequence, mot_sequence, select_in_sight, select_remembered
from harness.scoring.settings import ScoringSettings
from harness.scoring.statistics import Interval
from harness.sensor.observation import HIDDEN
from mmpf.compute.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class MotScores:
    """Multi-object scores; accuracies in percent.

    Attributes:
        hota: Higher order tracking accuracy.
        deta: Its detection half.
        assa: Its association half.
        idf1: Identity F1 score.
        mota: CLEAR accuracy.
        id_switches: Identity switches.
        fragmentations: Times that a vehicle's tracking stopped and went on, be it because the vehicle left the set.
        missed: Vehicle-steps without a track.
        false_tracks: Track-steps without a vehicle.
        false_tracks_per_scan: The same per step.
        id_switches_per_vehicle_minute: Identity switches per minute of a vehicle in the set.
        truth_n: Vehicle-steps.
        tracks_n: Track-steps.
    """

    hota: float
    deta: float
    assa: float
    idf1: float
    mota: float
    id_switches: int
    fragmentations: int
    missed: int
    false_tracks: int
    false_tracks_per_scan: float
    id_switches_per_vehicle_minute: float
    truth_n: int
    tracks_n: int


@dataclass(frozen=True)
class Scores:
    """All scores of a run.

    Attributes:
        mae: Mean errors by visibility state, with ``all``.
        by_seconds_hidden: Mean errors of hidden vehicles by the time since their last detection.
        hidden_outcomes: What became of hidden vehicles' tracks, over vehicle-steps.
        mot: Over vehicles in sight.
        mot_all: Over vehicles detected within the memory.
        gospa: Over vehicles in sight.
        occlusion: All occlusion events.
        occlusion_short: Those of at most 3 s.
        occlusion_long: Those of more than 3 s.
        calibration: Of all followed vehicles.
        calibration_visible: Of visible and partly visible vehicles.
        calibration_hidden: Of hidden vehicles.
        coverage: What the sensor and tracker covered at all.
        detection_noise: Mean errors of the detections.
    """

    mae: dict[str, MeanErrors]
    by_seconds_hidden: tuple[HiddenBin, ...]
    hidden_outcomes: HiddenOutcomes
    mot: MotScores
    mot_all: MotScores
    gospa: GospaScores
    occlusion: OcclusionCounts
    occlusion_short: OcclusionCounts
    occlusion_long: OcclusionCounts
    calibration: Calibration
    calibration_visible: Calibration
    calibration_hidden: Calibration
    coverage: Coverage
    detection_noise: DetectionNoise


@dataclass(frozen=True)
class Evaluation:
    """The scores of a run and the tables behind them.

    Attributes:
        scores: All scores.
        errors: One row per vehicle and step, see ``error_table``.
        events: One row per occlusion event, see ``event_table``.
    """

    scores: Scores
    errors: pd.DataFrame
    events: pd.DataFrame


def score(
    truth: pd.DataFrame, detections: pd.DataFrame, tracks: pd.DataFrame, settings: ScoringSettings | None = None
) -> Scores:
    """Return the scores alone; see ``evaluate``."""
    return evaluate(truth, detections, tracks, settings).scores


def evaluate(
    truth: pd.DataFrame,
    detections: pd.DataFrame,
    tracks: pd.DataFrame,
    settings: ScoringSettings | None = None,
    seed: int = 0,
) -> Evaluation:
    """Score a run.

    Vehicle and track identities never connect across episodes. Tentative tracks are not reported and not scored.

    Args:
        truth: One row per vehicle and step.
        detections: One row per detection.
        tracks: One row per track and step.
        settings: The scoring rules' numbers; None for the published ones.
        seed: Seed of the bootstrap.

    Returns:
        The scores with the table of errors and the table of occlusion events.

    Raises:
        ValueError: The tables contradict each other or hold unknown states.
    """
    settings = settings or ScoringSettings()
    rows = read_run(truth, detections, tracks, settings.gate_lon_m)
    history = detection_history(rows.truth, settings)
    pairs = near_pairs(rows.truth, rows.tracks, settings)
    matching = match(rows, history, pairs, settings)
    table = error_table(truth, rows, history, matching, settings)
    errors = error_arrays(table)
    rng = np.random.default_rng(seed)
    events = occlusion_events(rows, matching, settings)
    in_sight = mot_sequence(rows, history, pairs, select_in_sight(rows, history, pairs, settings))
    remembered = mot_sequence(rows, history, pairs, select_remembered(rows, history, pairs, settings))
    followed, hidden = errors.tracked, errors.state == HIDDEN
    scores = Scores(
        mae=errors_by_state(errors, settings, rng),
        by_seconds_hidden=errors_by_time_hidden(errors, settings, rng),
        hidden_outcomes=hidden_outcomes(errors.outcome[hidden]),
        mot=_mot(in_sight, rows.time_s),
        mot_all=_mot(remembered, rows.time_s),
        gospa=gospa(in_sight, settings.gospa_cutoff_m, settings.gospa_order),
        occlusion=count_outcomes(events, 0.0, settings.memory_s),
        occlusion_short=count_outcomes(events, 0.0, settings.event_short_s),
        occlusion_long=count_outcomes(events, settings.event_short_s, settings.memory_s),
        calibration=_calibration(table, followed),
        calibration_visible=_calibration(table, followed & ~hidden),
        calibration_hidden=_calibration(table, followed & hidden),
        coverage=coverage(rows, history, matching, settings),
        detection_noise=detection_noise(rows),
    )
    return Evaluation(scores, table, event_table(truth, rows, events))


def _mot(sequence: MotSequence, time_s: FloatArray) -> MotScores:
    truths, tracks = len(sequence.truth_step), len(sequence.track_step)
    percent = 100.0 if truths else np.nan
    accuracy = hota(sequence)
    events = clear(sequence)
    step_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else np.nan
    return MotScores(
        hota=percent * accuracy.hota,
        deta=percent * accuracy.deta,
        assa=percent * accuracy.assa,
        idf1=percent * identity(sequence).idf1,
        mota=percent * events.mota,
        id_switches=events.id_switches,
        fragmentations=events.fragmentations,
        missed=events.missed,
        false_tracks=events.false_tracks,
        false_tracks_per_scan=events.false_tracks / len(time_s) if len(time_s) else np.nan,
        id_switches_per_vehicle_minute=events.id_switches / (truths * step_s / 60.0) if truths else np.nan,
        truth_n=truths,
        tracks_n=tracks,
    )


def _calibration(table: pd.DataFrame, chosen: BoolArray) -> Calibration:
    error = table[["lon_error_m", "lat_error_m", "speed_error_mps"]].to_numpy(dtype=np.float64)
    std = table[["std_lon_m", "std_lat_m", "std_speed_mps"]].to_numpy(dtype=np.float64)
    return calibration(error[chosen], std[chosen])


def metrics_dict(scores: Scores) -> dict[str, Any]:
    """Lay the scores out under their published keys; nan becomes None, an interval a list of two numbers."""
    mae: dict[str, Any] = {state: _plain(means) for state, means in scores.mae.items()}
    mae["by_seconds_hidden"] = [_bin(row) for row in scores.by_seconds_hidden]
    return {
        "mae": mae,
        "hidden_outcomes": _plain(scores.hidden_outcomes),
        "mot": _plain(scores.mot),
        "mot_all": _plain(scores.mot_all),
        "gospa": _plain(scores.gospa),
        "occlusion": {
            **_plain(scores.occlusion),
            "short": _plain(scores.occlusion_short),
            "long": _plain(scores.occlusion_long),
        },
        "calibration": {
            **_plain(scores.calibration),
            "visible": _plain(scores.calibration_visible),
            "hidden": _plain(scores.calibration_hidden),
        },
        "coverage": _plain(scores.coverage),
        "detection_noise": _plain(scores.detection_noise),
    }


def _bin(row: HiddenBin) -> dict[str, Any]:
    outcomes = _plain(row.outcomes)
    return {"from_s": row.from_s, "to_s": row.to_s, **_plain(row.errors), "hidden_n": outcomes.pop("n"), **outcomes}


def _plain(value: object) -> Any:  # noqa: ANN401  plain values of any kind come out as they went in
    if isinstance(value, Interval):
        return None if math.isnan(value.low) else [value.low, value.high]
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
