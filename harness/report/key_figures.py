"""The key figures of a run, each with its interval, the perfect value and a reference value."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from markupsafe import Markup

from harness.common.effects import LEVEL
from harness.common.intervals import clopper_pearson, garwood
from harness.common.numbers import number
from harness.report.html_tables import below, html_table
from harness.report.summary_text import FEWEST_EVENTS, FEWEST_KM, FEWEST_SAMPLES, decided, driven, needed_brakings
from harness.running.finished import RecordedRun
from harness.scoring.evidence.rules import (
    FOLLOW_CUTOFF_M,
    IN_SIGHT_DETECTIONS,
    IN_SIGHT_S,
    PLAIN_VIEW_M,
    PLAIN_VIEW_S,
    TIME_TOLERANCE_S,
)
from harness.storage.tables import floats
from mmpf.numerics.arrays import FloatArray, turned

HEADINGS = ("", "this run", "perfect", "to compare with")
UNKNOWN = number(None, 0)
"""The value of what this run did not measure, which is not shown."""
STATE = ["lon_m", "lat_m", "speed_mps", "lat_speed_mps", "heading_rad"]


@dataclass(frozen=True)
class KeyFigure:
    """A figure of a run, as text.

    Attributes:
        note: How it is counted, with the definition of a term in its name.
        interval: Its 95 % interval; empty for none.
        detail: What it is over, or the same in another unit.
        reference: A value to compare it with.
        at_top: Whether it stands at the top of the page too.
    """

    name: str
    note: str
    value: str
    interval: str = ""
    detail: str = ""
    perfect: str = ""
    reference: str = ""
    at_top: bool = False


def key_table(figures: Sequence[KeyFigure]) -> Markup:
    """Return the table of the figures."""
    rows = [
        [each.name + below(each.note), each.value + below(each.detail, each.interval), each.perfect, each.reference]
        for each in figures
        if each.value != UNKNOWN
    ]
    return html_table(HEADINGS, rows)


def key_figures(run: RecordedRun) -> list[KeyFigure]:
    """Return the figures of a run; none of decisions where no driver was asked."""
    metrics, coasting_m = run.metrics, coasting_errors_m(run)
    mae, mot, hidden = metrics["mae"], metrics["mot"], metrics.get("hidden") or {}
    plain, noise = metrics.get("in_plain_view") or {}, metrics.get("detection_noise") or {}
    occlusion, step_ms = metrics["occlusion"], metrics["timing"]["tracker_ms"]
    tracks, scans = metrics["mot_all"].get("tracks_n"), metrics["timing"]["steps"]
    events, kept = occlusion["events"] or 0, occlusion["same_id"] or 0
    told = "constant velocity from the true state when last detected"
    coverage = metrics["calibration"]
    samples, within = coverage.get("n") or 0, number(coverage["coverage95"]["lon"], 0, " %")
    within = "too few samples" if 0 < samples < FEWEST_SAMPLES else within
    noise_m = np.hypot(noise["lon_m"], noise["lat_m"]) if noise.get("n") else 0.0
    return [
        KeyFigure(
            "Error of hidden vehicles, 10 m if lost",
            "mean over all that were detected before; called hidden cost in tables",
            number(hidden.get("hidden_cost_m"), 2, " m"), _between(hidden.get("hidden_cost_m_ci95"), " m"),
            perfect="0 m", reference=f"{coasting_m.mean():.2f} m: {told}" if len(coasting_m) else "", at_top=True,
        ),
        KeyFigure(
            "Same track after an occlusion", "hidden for half a second or longer, then detected again",
            f"{kept} of {events}" if events else "no case", *_share(kept, events), "all", at_top=True,
        ),
        KeyFigure(
            "Vehicles in plain view with a track",
            f"within {PLAIN_VIEW_M:g} m, share of the time; in plain view: visible for {PLAIN_VIEW_S:g} s or longer",
            number(plain.get("recall"), 1, " %"), detail=f"of {plain['n']} vehicle-steps" if plain.get("n") else "",
            perfect="100 %", at_top=True,
        ),
        KeyFigure(
            "HOTA of vehicles in sight",
            "detection and identity in one score; in sight: detected at least "
            f"{IN_SIGHT_DETECTIONS} times, the last time at most {IN_SIGHT_S:g} s ago",
            number(mot["hota"], 1, " %"), perfect="100 %", at_top=True,
        ),
        *_brakings(run),
        KeyFigure(
            "False tracks out of sight",
            f"tracks of no vehicle, mean number at a time; out of sight: nothing detected there for {IN_SIGHT_S:g} s",
            number(hidden.get("false_hidden_tracks_per_scan"), 2),
            detail=f"of {tracks / scans:.1f} tracks in all" if tracks and scans else "", perfect="0",
        ),
        KeyFigure(
            "Position error of visible vehicles", "while a track follows them",
            number(mae["visible"].get("position_m"), 2, " m"), _between(mae["visible"].get("position_m_ci95"), " m"),
            perfect="0 m",
            reference=f"{noise_m:.2f} m: detections" if noise_m else "",
        ),
        KeyFigure(
            "Identity switches in sight", "a vehicle's track is replaced by another", number(mot["id_switches"], 0),
            detail=f"{number(mot.get('id_switches_per_vehicle_minute'), 2)} per vehicle and minute", perfect="0",
        ),
        KeyFigure(
            "True position within the track's 95 % interval",
            "along the road, all vehicles; lower: the tracker is too sure, higher: too unsure",
            within, detail=f"n = {samples} vehicle-steps", perfect="95 %",
        ),
        KeyFigure(
            "Computing time of a step", "median, on the machine named below",
            UNKNOWN if run.is_log else number(step_ms["p50"], 0, " ms"),
            detail=f"99 % within {number(step_ms['p99'], 0, ' ms')}",
            reference=f"{1000.0 * run.step_s:.0f} ms: real time",
        ),
    ]  # fmt: skip


def _brakings(run: RecordedRun) -> list[KeyFigure]:
    """Return how often the ego's driver would brake wrongly by the tracks; none where no driver was asked."""
    if not (decisions := decided(run.metrics)):
        return []
    missed, phantom, km = decisions["missed"], decisions["phantom"], decisions["km"]
    needed = needed_brakings(decisions)
    interval, few = _share(missed, needed)
    least, most = np.multiply(phantom, garwood(phantom)) if phantom else (0.0, -np.log(0.5 * LEVEL))
    return [
        KeyFigure(
            "Missed brakings", "a driver brakes for the true vehicles, but not for the tracks",
            f"{missed} of {needed}" if needed else "no case", interval,
            f"in {driven(km)}" + (f"; {few}" if needed and few else ""), "0", at_top=True,
        ),
        KeyFigure(
            "Phantom brakings", "the driver brakes for the tracks, but not for the true vehicles", str(phantom),
            f"{least / km:.1f} to {most / km:.1f} per km" if km >= FEWEST_KM else "",
            f"in {driven(km)}" + (f": {number(decisions['phantom_per_km'], 2)} per km" if km >= FEWEST_KM else ""),
            "0", at_top=True,
        ),
    ]  # fmt: skip


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
    # By its time: steps of a log need not be equally long.
    clock = run.truth.drop_duplicates("step")
    then = np.searchsorted(floats(clock, "time_s"), floats(hidden, "time_s") - since_s - TIME_TOLERANCE_S)
    begun = truth.reindex(pd.MultiIndex.from_arrays([clock["step"].to_numpy(dtype=np.int64)[then], names]))
    now = truth.reindex(pd.MultiIndex.from_arrays([steps, names]))
    ahead, aside = (floats(begun, name) for name in ("speed_mps", "lat_speed_mps"))
    ahead, aside = turned(ahead, aside, -run.road.axis_of(floats(begun, "heading_rad")))
    off_m = np.hypot(
        floats(begun, "lon_m") + ahead * since_s - floats(now, "lon_m"),
        floats(begun, "lat_m") + aside * since_s - floats(now, "lat_m"),
    )
    known: FloatArray = off_m[np.isfinite(off_m)]
    return np.minimum(known, FOLLOW_CUTOFF_M)


def _share(successes: int, trials: int) -> tuple[str, str]:
    """Return the 95 % interval of a share, see ``clopper_pearson``, or empty and that there are too few trials."""
    if trials < FEWEST_EVENTS:
        return "", f"too few samples, n = {trials}"
    low, high = clopper_pearson(successes / trials, trials)
    return f"{100 * low:.0f} to {100 * high:.0f} %", ""


def _between(interval: Sequence[float] | None, unit: str) -> str:
    return f"{interval[0]:.2f} to {interval[1]:.2f}{unit}" if interval else ""
