"""Scores as the plain nested dictionary that is written to ``metrics.json``."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from typing import Any

from harness.scoring.mae import HiddenBin
from harness.scoring.score import Scores
from harness.scoring.statistics import Interval


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
