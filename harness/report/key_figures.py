"""The key figures of a run, each with its interval, the perfect value and a reference value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from harness.common.intervals import clopper_pearson
from harness.report.html_tables import html_table
from harness.report.summary_text import FEWEST_EVENTS, FEWEST_SAMPLES, number
from harness.running.finished import RecordedRun
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M
from harness.storage.tables import floats
from mmpf.numerics.arrays import FloatArray, turned

HEADINGS = ("", "this run", "perfect", "to compare with")
HIDDEN_ERROR, SAME_TRACK, PLAIN_VIEW, HOTA = (
    "Error of hidden vehicles, 10 m if lost",
    "Same track after an occlusion",
    "Vehicles in plain view with a track",
    "HOTA of vehicles in sight",
)
FIRST = (HIDDEN_ERROR, SAME_TRACK, PLAIN_VIEW, HOTA)
"""What stands at the top of the page."""
STATE = ["lon_m", "lat_m", "speed_mps", "lat_speed_mps", "heading_rad"]

Row = tuple[str, str, str, str, str, str]
"""What, how it is to be read, the value, its interval, what is perfect, and what to compare it with."""


def key_rows(run: RecordedRun) -> list[Row]:
    """Return the figures of a run."""
    return _rows(run.metrics, coasting_errors_m(run), run.step_s)


def first_figures(found: Sequence[Row]) -> list[tuple[str, str, str, str]]:
    """Return name, value, interval and what to compare it with of the figures that stand at the top of the page."""
    known = (row for row in found if row[0] in FIRST and row[2] != "-")
    return [(name, value, spread, other or f"perfect: {best}") for name, _, value, spread, best, other in known]


def key_figures(found: Sequence[Row]) -> Markup:
    """Return the table."""
    rows: list[list[str | Markup]] = []
    for name, note, value, interval, perfect, other in found:
        cells = [(name, note), (value, interval)]
        two_lines = [Markup("{}<br><span class='interval-cell'>{}</span>").format(*cell) for cell in cells]
        rows.append([*two_lines, perfect, other])
    return html_table(HEADINGS, rows)


def coasting_errors_m(run: RecordedRun) -> FloatArray:
    """Return how far off hidden vehicles are predicted at constant velocity from where they were last detected.

    Each prediction starts from the vehicle's true state at that step, and is never given up. There is a distance in
    metres for each step at which a vehicle that was seen is hidden, at most the cut-off of the hidden cost, shape (n,).
    """
    hidden = run.errors[(run.errors["state"].astype(object) == "hidden").to_numpy()]
    since_s = floats(hidden, "seconds_hidden")
    names = hidden["vehicle_id"].astype(object).to_numpy()
    steps = hidden["step"].to_numpy(dtype=np.int64)
    truth = run.truth.set_index([run.truth["step"], run.truth["vehicle_id"].astype(object)])[STATE]
    begun = truth.reindex(pd.MultiIndex.from_arrays([steps - np.rint(since_s / run.step_s).astype(np.int64), names]))
    now = truth.reindex(pd.MultiIndex.from_arrays([steps, names]))
    ahead, aside = (floats(begun, name) for name in ("speed_mps", "lat_speed_mps"))
    ahead, aside = turned(ahead, aside, -run.road.axis_of(floats(begun, "heading_rad")))
    off_m = np.hypot(
        floats(begun, "lon_m") + ahead * since_s - floats(now, "lon_m"),
        floats(begun, "lat_m") + aside * since_s - floats(now, "lat_m"),
    )
    known: FloatArray = off_m[np.isfinite(off_m)]
    return np.minimum(known, FOLLOW_CUTOFF_M)


def _rows(metrics: Mapping[str, Any], coasting_m: FloatArray, step_s: float) -> list[Row]:
    mae, mot, hidden = metrics["mae"], metrics["mot"], metrics.get("hidden") or {}
    plain, noise = metrics.get("in_plain_view") or {}, metrics.get("detection_noise") or {}
    occlusion, step_ms = metrics["occlusion"], metrics["timing"]["tracker_ms"]
    tracks, scans = metrics["mot_all"].get("tracks_n"), metrics["timing"]["steps"]
    at_a_time = f"of {tracks / scans:.1f} tracks in all" if tracks and scans else ""
    events, kept = occlusion["events"] or 0, occlusion["same_id"] or 0
    told = "constant velocity from the true state when last seen"
    coasting = f"{coasting_m.mean():.2f} m: {told}" if len(coasting_m) else ""
    coverage = metrics["calibration"]
    samples = coverage.get("n") or 0
    within = number(coverage["coverage95"]["lon"], 0, " %")
    sensor = f"{np.hypot(noise['lon_m'], noise['lat_m']):.2f} m: detections" if noise.get("n") else ""
    return [
        (
            HIDDEN_ERROR, "mean over all that were seen before",
            number(hidden.get("hidden_cost_m"), 2, " m"), _between(hidden.get("hidden_cost_m_ci95"), " m"), "0 m",
            coasting,
        ),
        (
            SAME_TRACK, "hidden for half a second or longer, then seen again",
            f"{kept} of {events}" if events else "no case",
            _share(kept, events) if events >= FEWEST_EVENTS else f"too few samples, n = {events}", "all", "",
        ),
        (
            "False tracks out of sight", "tracks that follow no vehicle, mean number at a time",
            number(hidden.get("false_hidden_tracks_per_scan"), 2), at_a_time, "0", "",
        ),
        (
            PLAIN_VIEW, "within 60 m, share of the time", number(plain.get("recall"), 1, " %"),
            f"of {plain['n']} vehicle-steps" if plain.get("n") else "", "100 %", "",
        ),
        (
            "Position error of visible vehicles", "while a track follows them",
            number(mae["visible"].get("position_m"), 2, " m"), _between(mae["visible"].get("position_m_ci95"), " m"),
            "0 m", sensor,
        ),
        (HOTA, "detection and identity in one score", number(mot["hota"], 1, " %"), "", "100 %", ""),
        (
            "Identity switches in sight", "a vehicle's track is replaced by another", number(mot["id_switches"], 0),
            f"{number(mot.get('id_switches_per_vehicle_minute'), 2)} per vehicle and minute", "0", "",
        ),
        (
            "True position within the track's 95 % interval", "along the road, all vehicles",
            within if samples >= FEWEST_SAMPLES else "too few samples", f"n = {samples} vehicle-steps", "95 %",
            "lower: too sure; higher: too unsure",
        ),
        (
            "Computing time of a step", "median, on the machine named below", number(step_ms["p50"], 0, " ms"),
            f"99 % within {number(step_ms['p99'], 0, ' ms')}", "", f"{1000.0 * step_s:.0f} ms: real time",
        ),
    ]  # fmt: skip


def _share(successes: int, trials: int) -> str:
    """Return the 95 % interval of a share; see ``clopper_pearson``."""
    low, high = clopper_pearson(successes / trials, trials)
    return f"{100 * low:.0f} to {100 * high:.0f} %"


def _between(interval: Sequence[float] | None, unit: str) -> str:
    return f"{interval[0]:.2f} to {interval[1]:.2f}{unit}" if interval else ""
