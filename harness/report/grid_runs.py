"""Links from a grid's page to its runs: an overview of cells, and each cell's runs with page or command."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
import pandas as pd
from markupsafe import Markup

from harness.analysis.coasting_ratio import COASTING_TRACKER
from harness.analysis.compare import compare
from harness.analysis.curve_charts import grid_charts
from harness.analysis.curves import ratio_of, summed_by, sums_and_weights
from harness.analysis.leading import leading_sentence
from harness.analysis.rules import compared_quantities
from harness.analysis.sources import open_source
from harness.analysis.verdicts import BETTER, WORSE
from harness.common.charts import Charts
from harness.common.errors import InputError
from harness.common.numbers import number
from harness.common.untrusted_files import read_json
from harness.grid.cells import GridPlan, PlannedRun, command_of
from harness.grid.grid import GridRequest, plan_grid
from harness.report.html_tables import html_table
from harness.report.page import PAGE
from harness.scoring.metrics.quantity import Quantity
from harness.storage import run_folder as runfolder
from harness.storage.grid_folder import GRID, KEPT, RUNS, column_of
from harness.storage.schema import DENSITY, MODEL_FILE
from mmpf.numerics.arrays import FloatArray

BESIDE = runfolder.BESIDE
RANKED = "mot.hota"
SHOWN = ("hidden.hidden_cost_m", "occlusion.same_id_percent", RANKED)
MOST_LISTED, MOST_TOLD = 2_000, 6
Pairs = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class RunsOfGrid:
    """What leads from a grid's page to its runs.

    Attributes:
        conclusion: Which tracker is ahead, and by how much; empty where there are not two.
        compared: The trackers whose verdict it tells, as pairs in the grid's order; empty where there is none.
        about: What was run, in words.
        metric: What the overview shows, with its unit.
        overview: One row a tracker, one column a setting; each value leads to its cell, in the order of ``cells``.
        cells: Each tracker in each setting, with the table of its runs: a row a seed, with page or command.
        left_out: How many runs are not listed.
        charts: The curves over each axis, by its name in words, whose points lead to the cells; empty where there are
            none.
    """

    conclusion: str
    compared: Pairs
    about: str
    metric: str
    overview: Markup
    cells: tuple[tuple[str, Markup], ...]
    left_out: int
    charts: Mapping[str, Charts]


def runs_of(folder: Path) -> RunsOfGrid | None:
    """Return what leads to the runs of a grid's folder; None if it is none, or of another version."""
    if (grid := plan_of(folder)) is None or not (folder / RUNS).is_file():
        return None
    table = runfolder.read_table(folder, RUNS, "folder", ("seed", "succeeded"))
    if len(table) != len(grid.runs):
        return None
    shown = [quantity for key in SHOWN for quantity in compared_quantities() if quantity.key == key]
    values = np.stack([column_of(table, quantity.key) for quantity in shown], axis=-1)
    nets = list(dict.fromkeys(run.config.traffic.net for run in grid.runs))
    files = table[MODEL_FILE].tolist() if MODEL_FILE in table else [None] * len(table)
    placed = sorted(
        (
            (_tracker(run, files[place]), _setting(run, len(nets) > 1), place, run)
            for place, run in enumerate(grid.runs)
        ),
        key=lambda each: (each[0], nets.index(each[3].config.traffic.net), _order(each[3]), each[1]),
    )
    listed = placed[:MOST_LISTED]
    cells: list[tuple[str, Markup]] = []
    links: dict[tuple[str, str], Markup] = {}
    cell_of: list[int | None] = [None] * len(placed)
    beside = {run.key: cell.runs[0] for cell in grid.cells for run in cell.runs[1:]}
    for cell, ((tracker, setting), members) in enumerate(groupby(listed, key=lambda each: each[:2]), start=1):
        runs = [(place, run) for _, _, place, run in members]
        text = _mean(table.iloc[[place for place, _ in runs]], shown[0])
        links[tracker, setting] = Markup("<a href='#cell-{}'>{}</a>").format(cell, text)
        rows = [
            [
                str(run.config.seed),
                *(number(value, each.decimals) for each, value in zip(shown, values[place].tolist(), strict=True)),
                Markup(" · ").join(_ways(folder, run, beside.get(run.key))),
            ]
            for place, run in runs
        ]
        for place, _ in runs:
            cell_of[place] = cell
        headings = ["seed", *(quantity.heading or quantity.label for quantity in shown), "run"]
        cells.append((f"{tracker}, {setting}", html_table(headings, rows)))
    order = {setting: (nets.index(run.config.traffic.net), _order(run)) for _, setting, _, run in listed}
    settings = sorted(order, key=lambda setting: order[setting])
    trackers = list(dict.fromkeys(tracker for tracker, _ in links))
    overview = [[tracker, *(links.get((tracker, setting), "-") for setting in settings)] for tracker in trackers]
    has_curves = not grid.is_replay and not any(run.mismatch for run in grid.runs)
    return RunsOfGrid(
        *_conclusion(folder, placed, values[:, SHOWN.index(RANKED)]),
        about=_about(grid),
        metric=shown[0].label,
        overview=html_table(["tracker", *settings], overview),
        cells=tuple(cells),
        left_out=len(placed) - len(listed),
        charts=grid_charts(table, grid.axes, cell_of) if has_curves else {},
    )


def _conclusion(folder: Path, placed: list[tuple[str, str, int, PlannedRun]], scores: FloatArray) -> tuple[str, Pairs]:
    """Return the outcome over all trackers that are not told the truth, and whose verdict it tells."""
    compared: list[tuple[str, str]] = []
    in_order = [tracker for tracker, *_ in sorted(placed, key=lambda each: each[2])]

    def decided(first: str, second: str) -> bool | None:
        a, b = sorted((first, second), key=in_order.index)
        try:
            if not {a, b} <= set(open_source(str(folder), "folder").labels):
                return None  # they differ in a setting that was varied, by which ``compare`` tells no trackers apart
            first_side, other_side = (open_source(f"{folder}@{label}", "folder") for label in (a, b))
            judged = compare(first_side, other_side).primary
        except (InputError, ValueError):
            return False
        compared.append((a, b))
        return any(each.metric == RANKED and each.verdict == (WORSE if a == first else BETTER) for each in judged)

    rows = [
        {"tracker": tracker, "setting": setting, "unit": run.config.replay or run.config.seed, "score": scores[place]}
        for tracker, setting, place, run in placed
        if run.config.tracker.name != COASTING_TRACKER
    ]
    ranked = next(quantity for quantity in compared_quantities() if quantity.key == RANKED)
    return leading_sentence(pd.DataFrame(rows), ranked, decided) if rows else "", tuple(compared)


def _about(grid: GridPlan) -> str:
    """Return in a sentence which trackers were run on what."""
    configs = [run.config for run in grid.runs]
    meant = {label: f" ({tracker})" for label, tracker in grid.labels.items()}
    trackers = ", ".join(dict.fromkeys(_tracker(run) + meant.get(run.variant, "") for run in grid.runs))
    settings = list(dict.fromkeys(_setting(run, several_nets=True) for run in grid.runs))
    where = f"on {'; '.join(settings)}" if len(settings) <= MOST_TOLD else f"in the {len(settings)} settings below"
    seeds = sorted({config.seed for config in configs})
    durations = "; ".join(dict.fromkeys(f"{config.traffic.duration_s:g} s" for config in configs))
    sensors = ", ".join(dict.fromkeys(config.sensor.profile for config in configs))
    shown = f"seeds {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"seed {seeds[0]}"
    told = f" {COASTING_TRACKER} is told which vehicle each detection is of: a reference, not a tracker."
    note = told if any(config.tracker.name == COASTING_TRACKER for config in configs) else ""
    return f"Trackers: {trackers}. Each runs {where}, with {shown}, for {durations}, with the sensor {sensors}.{note}"


def _mean(runs: pd.DataFrame, quantity: Quantity) -> str:
    """Return the mean over a cell's runs, weighted as in the curves."""
    mean, _ = ratio_of(*summed_by("seed", runs, *sums_and_weights(runs, quantity)))
    return number(mean, quantity.decimals)


def plan_of(folder: Path) -> GridPlan | None:
    """Return the grid that a folder was made for; None if it is none, or of another version."""
    try:
        request = read_json(folder / GRID)
        lists = {name: tuple(value) for name, value in request.items() if isinstance(value, list)}
        return plan_grid(GridRequest(**request | lists))
    except (OSError, ValueError, TypeError, AttributeError, InputError):
        return None


def _ways(folder: Path, run: PlannedRun, first: PlannedRun | None) -> Iterator[Markup]:
    """Yield what leads to a run: its pages if it was kept, or else the command that makes it again."""
    place = f"{KEPT}/{run.key}"
    if not (folder / place / PAGE).is_file():
        yield Markup("<code class='command'>{}</code>").format(command_of(run.config))
        return
    yield Markup("<a href='{}/{}'>page and replay</a>").format(place, PAGE)
    if first is not None and (folder / place / BESIDE).is_file():
        yield Markup("<a href='{}/{}'>beside {}</a>").format(place, BESIDE, _tracker(first))


def _tracker(run: PlannedRun, file: object = None) -> str:
    own = [f"{key}={value:g}" for key, value in run.varied.items() if key.startswith("tracker.")]
    model = None if "model=" in run.variant else run.config.tracker.model  # as ``compare`` calls it
    return " ".join(word for word in (run.variant, model, file if isinstance(file, str) else "", *own) if word)


def _setting(run: PlannedRun, several_nets: bool) -> str:
    traffic = run.config.traffic
    where = f"{traffic.density:g} veh/km/lane" if traffic.density is not None else traffic.demand
    recording = Path(run.config.replay).name if run.config.replay is not None else None
    shared = [f"{key}={value:g}" for key, value in run.varied.items() if not key.startswith("tracker.")]
    net = traffic.net if several_nets else None
    return ", ".join(word for word in (net, recording or where or traffic.net, *shared, run.mismatch) if word)


def _order(run: PlannedRun) -> float:
    return float(run.identity()[DENSITY] or 0.0)
