"""The page of a comparison: two runs on the same detections share one replay, side by side, as kept runs of a grid."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.analysis.compare import Judgement, compare
from harness.analysis.comparison_text import as_markdown
from harness.analysis.rules import Rules, name_of, quantity_of
from harness.analysis.sources import open_source
from harness.analysis.verdicts import BETTER, NO_WORSE, UNDECIDED, UNTESTED, WORSE, Verdict
from harness.analysis.why import SWITCH, TrackFailure, Why
from harness.common.charts import HIT_AREA, Chart, Charts, Spec, colour_by, spec_of, strength, tooltip_of
from harness.common.files import write_text
from harness.common.progress import progress_bar
from harness.grid.cells import Cell, PlannedRun
from harness.report.folder_page import as_html, text_page, title_of
from harness.report.grid_runs import BESIDE, plan_of
from harness.report.page import MOST_SHOWN, PAGE, chart_parts, render, replay_parts, write_run_page
from harness.report.replay_data import SecondRun
from harness.running.finished import RecordedRun, read_recorded_run
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M, TIME_TOLERANCE_S
from harness.storage import ownership
from harness.storage import run_folder as runfolder
from harness.storage.checks import sound_tables
from harness.storage.grid_folder import KEPT
from harness.storage.tables import floats

UNFOLLOWED, SWITCHED, FARTHER = range(3)
"""Kinds of marks: the other alone follows the vehicle; its identity was switched; it is followed from farther off."""
FARTHER_M = 1.0
SWITCH_SHOWN_S, WATCHED_S = 1.0, 4.0
MARK_COLUMNS = ("step", "vehicle_id", "kind", "side")
DETECTED = ["step", "lon_m", "lat_m"]
COMPARE = "compare"


def comparison_page(comparison: Judgement) -> str:
    """Return a comparison as a page.

    Raises:
        InputError: A table of one of two single runs is missing or broken.
    """
    both = _same_detections(comparison.why) if comparison.why is not None else None
    effects = comparison_charts(comparison)
    charts = {"Differences": effects} if effects is not None else {}
    if comparison.why is None or both is None:
        return text_page(as_markdown(comparison), charts, f"{comparison.b} (b) is compared with {comparison.a} (a).")
    why, text = comparison.why, as_markdown(comparison, with_replay=True)
    a, b = both
    marks = differences(a, b, (why.a, why.b))
    sides = (a.config.tracker.in_words(), why.folder_a), (b.config.tracker.in_words(), why.folder_b)
    return render(
        "comparison.html.j2",
        title=title_of([text]) or "Comparison",
        text=as_html(text),
        charts=charts,
        **chart_parts(list(charts.values())),
        **replay_parts(a, SecondRun(b, marks, largest_difference(marks, a.truth)), sides),
    )


def largest_difference(marks: pd.DataFrame, truth: pd.DataFrame) -> tuple[float, str] | None:
    """Return the time at which the two trackers differ for most vehicles, and one of these; None if they never do."""
    if not len(marks):
        return None
    times = truth.drop_duplicates("step").set_index("step")["time_s"]
    early = marks[marks["step"].map(times) <= times.max() - WATCHED_S]
    marks = early if len(early) else marks  # at the end there is nothing left to watch
    step = marks["step"].value_counts(sort=False).idxmax()
    time_s = floats(truth[truth["step"] == step], "time_s")[0]
    return float(time_s), str(marks.loc[marks["step"] == step, "vehicle_id"].iloc[0])


def differences(
    a: RecordedRun, b: RecordedRun, failures: tuple[Sequence[TrackFailure], Sequence[TrackFailure]]
) -> pd.DataFrame:
    """Return where two trackers on the same detections differ, given the failures of each.

    Returns:
        A row with ``step``, ``vehicle_id``, ``kind`` and ``side`` for each difference and step: ``UNFOLLOWED`` where
        only the other follows the vehicle, as the hidden cost counts it, ``FARTHER`` where both do and this one is more
        than 1 m farther off, and ``SWITCHED`` for a second after an identity switch that the other does not have in
        that second. ``side``, 0 or 1, is the one that is worse. Sorted by step.
    """
    place = ["step", "vehicle_id"]
    first, second = (_errors(run) for run in (a, b))
    both = first.merge(second, on=place, suffixes=("_0", "_1"))
    marks: list[pd.DataFrame] = []
    for side, other in ((0, 1), (1, 0)):
        own, others = both[f"followed_{side}"], both[f"followed_{other}"]
        farther = own & others & (floats(both, f"off_m_{side}") - floats(both, f"off_m_{other}") > FARTHER_M)
        for kind, chosen in ((UNFOLLOWED, others & ~own), (FARTHER, farther)):
            marks.append(both.loc[chosen, place].assign(kind=kind, side=side))
        marks.append(_switches(a.truth, failures[side], failures[other]).assign(kind=SWITCHED, side=side))
    return pd.concat(marks).sort_values(["step", "side", "kind", "vehicle_id"], ignore_index=True)[list(MARK_COLUMNS)]


def _errors(run: RecordedRun) -> pd.DataFrame:
    errors = run.errors[["step", "vehicle_id", "outcome"]].astype({"vehicle_id": object, "outcome": object})
    off_m = np.hypot(floats(run.errors, "lon_error_m"), floats(run.errors, "lat_error_m"))
    followed = (errors["outcome"] == "tracked") & (off_m < FOLLOW_CUTOFF_M)
    return errors.drop(columns="outcome").assign(followed=followed, off_m=off_m)


def _switches(truth: pd.DataFrame, own: Sequence[TrackFailure], others: Sequence[TrackFailure]) -> pd.DataFrame:
    """Return the steps within a second after one's identity switches, without those that the other has as well."""
    times = truth.drop_duplicates("step")
    rows: list[tuple[int, str]] = []
    for failure in (failure for failure in own if failure.kind == SWITCH):
        same = (each for each in others if (each.kind, each.vehicle_id) == (SWITCH, failure.vehicle_id))
        if any(abs(each.time_s - failure.time_s) <= SWITCH_SHOWN_S for each in same):
            continue
        since_s = floats(times, "time_s") - failure.time_s
        shown = (since_s >= -TIME_TOLERANCE_S) & (since_s <= SWITCH_SHOWN_S + TIME_TOLERANCE_S)
        rows += [(int(step), failure.vehicle_id) for step in times["step"].to_numpy()[shown]]
    shown_at = pd.DataFrame(rows, columns=["step", "vehicle_id"]).drop_duplicates()
    return shown_at.astype({"step": np.int64, "vehicle_id": object})


def _same_detections(why: Why) -> tuple[RecordedRun, RecordedRun] | None:
    """Return both runs, as far as both were read; None where they are on different detections."""
    both = []
    for folder in (why.folder_a, why.folder_b):
        with sound_tables(Path(folder), COMPARE):
            both.append(read_recorded_run(Path(folder), COMPARE, MOST_SHOWN))
    a, b = both
    last = min(int(run.truth["step"].max()) for run in both)
    seen = [run.detections.loc[run.detections["step"] <= last, DETECTED].reset_index(drop=True) for run in both]
    return (a, b) if seen[0].equals(seen[1]) else None


def write_kept_pages(folder: Path, quiet: bool) -> None:
    """Write the pages of a grid's kept runs, and of each tracker beside the first of its cell."""
    grid = plan_of(folder)
    runs = grid.runs if grid is not None else ()
    kept = {run.key for run in runs if (folder / KEPT / run.key / runfolder.MANIFEST).is_file()}
    with progress_bar("pages of the runs", len(kept), quiet) as advance:
        for cell in grid.cells if grid is not None else ():
            first_is_new = not (folder / KEPT / cell.runs[0].key / PAGE).is_file()
            for run in (run for run in cell.runs if run.key in kept):
                if is_new := not (folder / KEPT / run.key / PAGE).is_file():
                    write_run_page(folder / KEPT / run.key)
                if is_new or first_is_new:
                    _write_beside(folder, cell, run, kept)
                advance()


def _write_beside(folder: Path, cell: Cell, run: PlannedRun, kept: set[str]) -> None:
    first = cell.runs[0]
    if run.key == first.key or first.key not in kept:
        return
    a, b = (open_source(str(folder / KEPT / each.key), "folder") for each in (first, run))
    page = b.folder / BESIDE
    write_text(page, comparison_page(compare(a, b)))
    ownership.add(b.folder, [page])


IN_WORDS = {UNTESTED: "described, not tested"}
COLOURS = (
    (WORSE, "var(--hidden)"),
    (UNDECIDED, "var(--partial)"),
    (NO_WORSE, "var(--visible)"),
    (BETTER, "var(--series-0)"),
    (IN_WORDS[UNTESTED], "var(--edge)"),
)
LINEAR_PERCENT = 3.0
"""Up to this the scale is even; beyond, equal ratios take equal lengths."""
TICKS = [-1000, -100, -10, -3, 0, 3, 10, 100, 1000]
LEAST_CHANGE, MOST_CHANGE = 5.0, 2000.0
ZERO_PLAIN = "datum.value == 0 ? '0' : format(datum.value, '+,d')"
ROW_PX, FRAME_PX = 40, 60
NOTE = (
    "How much better (right) or worse (left) b is than a, in percent of a's value, with 95 % intervals. The grey band "
    "is the tolerance: b is no worse if its whole interval lies to the right of the band's left edge. Beyond {:g} %, "
    "the scale is logarithmic. A dot without a line has no interval. MAE is the mean absolute error; HOTA and IDF1 are "
    "scores of detection and identity together; hidden cost is the mean position error of hidden vehicles, 10 m for "
    "one without a track; hidden CRPS also scores the deviations that tracks state."
)
NOT_DRAWN = " Not shown, because a is 0: {}."
HINT = "Point at a value to read it in its own unit."


def comparison_charts(comparison: Judgement) -> Charts | None:
    """Return a chart for each tracker that was compared; None where no metric has a difference."""
    charts = []
    for label in dict.fromkeys(verdict.label for verdict in comparison.verdicts):
        of_label = [verdict for verdict in comparison.verdicts if verdict.label == label]
        rows = [row for verdict in of_label if (row := _row(verdict, comparison.rules))]
        if rows:
            description = f"{label}: difference of b from a in each metric, with 95 % intervals"
            spec = spec_of(description, rows, _layers(rows), ROW_PX * len(rows) + FRAME_PX)
            charts.append(Chart(label, description, spec))
    shown = {row["verdict"] for chart in charts for row in chart.spec["data"]["values"]}
    lines = tuple(line for line in COLOURS if line[0] in shown)
    of_zero = dict.fromkeys(name_of(each.metric) for each in comparison.verdicts if each.a == 0.0 and each.difference)
    note = NOTE.format(LINEAR_PERCENT) + (NOT_DRAWN.format(", ".join(of_zero)) if of_zero else "")
    return Charts(tuple(charts), lines, note, HINT, wide=True) if charts else None


def _row(verdict: Verdict, rules: Rules) -> dict[str, Any] | None:
    """Return a metric's difference in percent of a, better positive; None where that has no meaning."""
    quantity = quantity_of(verdict.metric)
    if quantity.best is not None or not verdict.a or not math.isfinite(verdict.difference):
        return None
    scale = (100.0 if quantity.higher_is_better else -100.0) / abs(verdict.a)
    ends = sorted(scale * end for end in verdict.ci95) if math.isfinite(verdict.ci95[0]) else None
    low, high = (max(-MOST_CHANGE, min(MOST_CHANGE, end)) for end in ends) if ends else (None, None)
    judged = rules.judges(quantity) and math.isfinite(verdict.margin)
    band = 100.0 * verdict.margin / abs(verdict.a) if judged else None
    decimals = quantity.decimals + 1
    interval = f"{verdict.ci95[0]:+.{decimals}f} to {verdict.ci95[1]:+.{decimals}f}" if ends else "-"
    return {
        "metric": quantity.label,
        "change": max(-MOST_CHANGE, min(MOST_CHANGE, scale * verdict.difference)),
        "low": low,
        "high": high,
        "tolerance": band,
        "below": None if band is None else -band,
        "verdict": IN_WORDS.get(verdict.verdict, verdict.verdict),
        "values": f"{verdict.a:.{decimals}f} and {verdict.b:.{decimals}f}",
        "difference": f"{verdict.difference:+.{decimals}f}",
        "interval": interval,
        "pairs": str(verdict.pairs),
    }


def _layers(rows: Sequence[dict[str, Any]]) -> list[Spec]:
    shown = (row[name] for row in rows for name in ("change", "low", "high"))
    reach = 1.15 * max(LEAST_CHANGE, *(abs(value) for value in shown if value is not None))
    x: Spec = {
        "type": "quantitative",
        "title": "b worse  ←  change in % of a  →  b better",
        "scale": {"type": "symlog", "constant": LINEAR_PERCENT, "domain": [-reach, reach], "nice": False},
        "axis": {
            "values": [tick for tick in TICKS if abs(tick) <= reach],
            "labelExpr": ZERO_PLAIN,
            "labelOverlap": "greedy",
            "labelSeparation": 3,
        },
    }
    # Names stand above their rows, so that the plot keeps its width on a small screen.
    above: Spec = {"labelAlign": "left", "labelPadding": -4, "labelOffset": -14, "labelLimit": {"expr": "width"}}
    small: Spec = {"labelFontSize": {"expr": "width < 400 ? 10.5 : 12"}}
    axis: Spec = {"title": None, "grid": False, "ticks": False, "domain": False, "zindex": 1} | above | small
    y: Spec = {"field": "metric", "type": "nominal", "scale": {"domain": [row["metric"] for row in rows]}, "axis": axis}
    shade: Spec = {"color": colour_by("verdict", COLOURS), "opacity": strength("verdict")}
    change: Spec = {"y": y, "x": {**x, "field": "change"}}
    point: Spec = {"type": "point", "filled": True}
    values = (("values", "a and b"), ("difference", "b minus a"), ("interval", "95 % interval"))
    tooltip = tooltip_of(("metric", "metric"), *values, ("pairs", "pairs"), ("verdict", "b is"))
    return [
        {
            "mark": {"type": "bar", "height": {"band": 0.3}, "color": "var(--line)", "tooltip": None},
            "encoding": {"y": y, "x": {**x, "field": "below"}, "x2": {"field": "tolerance"}},
        },
        {"data": {"values": [{}]}, "mark": {"type": "rule"}, "encoding": {"x": {**x, "datum": 0}}},
        {
            "mark": {"type": "rule", "strokeWidth": 2},
            "encoding": {"y": y, "x": {**x, "field": "low"}, "x2": {"field": "high"}} | shade,
        },
        {"mark": point | {"size": 70}, "encoding": change | shade},
        {"mark": point | {"size": HIT_AREA, "opacity": 0}, "encoding": change | {"tooltip": tooltip}},
    ]
