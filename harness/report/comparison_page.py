"""The page of a comparison: two runs on the same detections share one replay, side by side, as kept runs of a grid."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from harness.analysis.compare import Judgement, compare
from harness.analysis.comparison_text import as_markdown
from harness.analysis.sources import open_source
from harness.analysis.why import SWITCH, TrackFailure, Why
from harness.common.files import write_text
from harness.common.progress import progress_bar
from harness.grid.cells import Cell, PlannedRun
from harness.report.comparison_chart import comparison_charts
from harness.report.folder_page import as_html, text_page, title_of
from harness.report.grid_runs import BESIDE, plan_of
from harness.report.page import MOST_SHOWN, PAGE, chart_parts, render, replay_parts, write_run_page
from harness.report.replay_data import SecondRun
from harness.running.finished import RecordedRun, read_recorded_run
from harness.scoring.evidence.rules import TIME_TOLERANCE_S
from harness.storage import ownership
from harness.storage import run_folder as runfolder
from harness.storage.checks import sound_tables
from harness.storage.grid_folder import KEPT
from harness.storage.tables import floats

UNFOLLOWED, SWITCHED, FARTHER = range(3)
"""Kinds of marks: the other alone follows the vehicle; its identity was switched; it is followed from farther off."""
FARTHER_M = 1.0
SWITCH_SHOWN_S = 1.0
BEFORE_S = 1.0
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
        return text_page(as_markdown(comparison), charts)
    why, text = comparison.why, as_markdown(comparison, with_replay=True)
    a, b = both
    marks = differences(a, b, (why.a, why.b))
    return render(
        "comparison.html.j2",
        title=title_of([text]) or "Comparison",
        text=as_html(text),
        charts=charts,
        **chart_parts(list(charts.values())),
        **replay_parts(a, SecondRun(b, marks, first_failure(why)), _headings(why, both)),
    )


def first_failure(why: Why) -> tuple[float, str] | None:
    """Return a moment before the first failure of either, and its vehicle; None where neither failed."""
    found = sorted((*why.a, *why.b), key=lambda failure: failure.time_s)
    return (max(0.0, found[0].time_s - BEFORE_S), found[0].vehicle_id) if found else None


def differences(
    a: RecordedRun, b: RecordedRun, failures: tuple[Sequence[TrackFailure], Sequence[TrackFailure]]
) -> pd.DataFrame:
    """Return where two trackers on the same detections differ, given the failures of each.

    Returns:
        A row with ``step``, ``vehicle_id``, ``kind`` and ``side`` for each difference and step: ``UNFOLLOWED`` where
        only the other follows the vehicle, ``FARTHER`` where both do and this one is more than 1 m farther off, and
        ``SWITCHED`` for a second after an identity switch that the other does not have in that second. ``side``, 0 or
        1, is the one that is worse. Sorted by step.
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
    errors = run.errors
    return pd.DataFrame(
        {
            "step": errors["step"].to_numpy(),
            "vehicle_id": errors["vehicle_id"].astype(object).to_numpy(),
            "followed": (errors["outcome"].astype(object) == "tracked").to_numpy(),
            "off_m": np.hypot(floats(errors, "lon_error_m"), floats(errors, "lat_error_m")),
        }
    )


def _switches(truth: pd.DataFrame, own: Sequence[TrackFailure], others: Sequence[TrackFailure]) -> pd.DataFrame:
    """Return the steps within a second after one's identity switches, without those that the other has as well."""
    times = truth.drop_duplicates("step")
    rows: list[tuple[int, str]] = []
    for failure in own:
        common = any(
            each.kind == SWITCH
            and each.vehicle_id == failure.vehicle_id
            and abs(each.time_s - failure.time_s) <= SWITCH_SHOWN_S
            for each in others
        )
        if failure.kind != SWITCH or common:
            continue
        since_s = floats(times, "time_s") - failure.time_s
        shown = (since_s >= -TIME_TOLERANCE_S) & (since_s <= SWITCH_SHOWN_S + TIME_TOLERANCE_S)
        rows += [(int(step), failure.vehicle_id) for step in times["step"].to_numpy()[shown]]
    return pd.DataFrame(rows, columns=["step", "vehicle_id"]).astype({"step": np.int64, "vehicle_id": object})


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


def _headings(why: Why, runs: tuple[RecordedRun, RecordedRun]) -> tuple[tuple[str, str], ...]:
    """Return for each side the label of its tracker, and its folder."""
    folders = (why.folder_a, why.folder_b)
    return tuple((run.config.tracker.in_words(), folder) for run, folder in zip(runs, folders, strict=True))


def write_kept_pages(folder: Path, quiet: bool) -> None:
    """Write the pages of a grid's kept runs, and of each tracker beside the first of its cell."""
    grid = plan_of(folder)
    runs = grid.runs if grid is not None else ()
    kept = {run.key for run in runs if (folder / KEPT / run.key / runfolder.MANIFEST).is_file()}
    with progress_bar("pages of the runs", len(kept), quiet) as advance:
        for cell in grid.cells if grid is not None else ():
            for run in (run for run in cell.runs if run.key in kept):
                if not (folder / KEPT / run.key / PAGE).is_file():
                    write_run_page(folder / KEPT / run.key)
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
