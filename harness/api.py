"""The harness from Python: ``run``, ``stress`` and ``compare``, and what they return.

The keywords are the commands' options: ``harness.config.options.RunOptions`` and ``harness.grid.options.GridOptions``.
Wrong input raises ``InputError``: one sentence that names the keyword and how to fix it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from html import escape
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypedDict, Unpack

import pandas as pd

from harness.common.error_text import drawing, shown
from harness.common.errors import InputError, RunError, RunInterruptedError
from harness.common.untrusted_files import read_json, reading
from harness.common.watching import survived
from harness.config.options import Option, RunOptions, checked, keys_of_options, setting_words
from harness.grid.options import GridOptions
from harness.running.resolve import external_code, resolve_run_config
from harness.storage.grid_folder import flattened
from harness.storage.run_folder import read_manifest, read_metrics, read_table
from mmpf.registry import UnknownNameError

__all__ = [
    "Comparison", "Grid", "GridOptions", "InputError", "Run", "RunError", "RunInterruptedError", "RunOptions",
    "compare", "open_run", "run", "stress",
]  # fmt: skip

if TYPE_CHECKING:
    from harness.config.model import RunConfig
    from harness.grid.making import RunCells
    from harness.grid.stress import FinishedGrid
    from harness.running.run import FinishedRun


def _table_of(name: str, about: str) -> cached_property[pd.DataFrame]:
    """Return a property that is a table of a run's folder, read on first use."""

    def table(run: Run) -> pd.DataFrame:
        return read_table(run.folder, f"{name}.parquet", "folder", ())

    table.__doc__ = about
    return cached_property(table)


@dataclass(frozen=True)
class Run:
    """A finished run; its tables are read from its folder on first use.

    Attributes:
        folder: Where its files lie.
    """

    folder: Path

    @cached_property
    def metrics(self) -> pd.DataFrame:
        """Every number of ``metrics.json`` in the column ``value``, by its key with dots; nan for null.

        ``label`` is its name with its unit, empty if pages do not show it.
        Keys of intervals end in ``.low`` and ``.high``, those of entries of a list in their index from 0.
        """
        content, labels = self._content
        flat = flattened(content)
        numbers = {name: value for name, value in flat.items() if not isinstance(value, str | bool)}
        values = pd.Series(numbers, dtype="float64")
        return pd.DataFrame({"value": values, "label": [labels.get(name, "") for name in values.index]}).rename_axis(
            "metric"
        )

    def _repr_html_(self) -> str:
        """Return a link to the run's page, if there is one, and its numbers, as notebooks show them."""
        return _linked(self.folder) + self.metrics.to_html()

    def __repr__(self) -> str:
        """Return the folder and what the run was of."""
        return f"Run({str(self.folder)!r}: {', '.join(f'{name} {value}' for name, value in self.about.items())})"

    @cached_property
    def about(self) -> dict[str, Any]:
        """What the run was of, by name, such as network, density, seed, tracker, motion model and sensor."""
        return {name: value for name, value in self._content[0].get("run", {}).items() if value is not None}

    @cached_property
    def _content(self) -> tuple[dict[str, Any], Mapping[str, str]]:
        """Return what is in ``metrics.json``, and the labels of its numbers."""
        from harness.running import finished  # noqa: PLC0415

        return read_metrics(self.folder, "folder"), finished.labels()

    truth = _table_of("truth", "One row per vehicle and step, with its place and how much of it the sensor could see.")
    detections = _table_of("detections", "One row per detection; ``truth_id`` is empty for clutter.")
    tracks = _table_of("tracks", "One row per track and step.")
    errors = _table_of("errors", "One row per step and vehicle detected so far, with its track and the track's error.")
    events = _table_of("events", "One row per occlusion, with its time, its length and whether the track lasted.")
    brakings = _table_of("brakings", "One row per missed or phantom braking, with its time and who was to blame.")
    commands = _table_of("commands", "One row per step, with what the ego's driver would do by truth and by tracks.")
    diagnostics = _table_of("diagnostics", "One row per step, with the tracker's diagnostics, if it reports any.")
    unseen = _table_of("unseen", "One row per step and stretch of lane, with the undetected vehicles expected there.")
    particles = _table_of("particles", "A sample of the particles at some of the steps.")

    def report(self) -> Path:
        """Return the run's page, ``report.html``; it is written if it is not there."""
        page = self.folder / "report.html"
        if not page.is_file():
            from harness.report.folder_page import write_page  # noqa: PLC0415

            return write_page(self.folder)
        return page


@dataclass(frozen=True)
class Grid:
    """A finished stress test.

    Attributes:
        folder: Where its files lie.
    """

    folder: Path

    def _repr_html_(self) -> str:
        """Return a link to the page, if there is one, and the curves' numbers, as notebooks show them."""
        return _linked(self.folder) + pd.DataFrame(self.summary.get("curves", [])).to_html(index=False)

    @cached_property
    def runs(self) -> pd.DataFrame:
        """One row per run, failed ones too, with ``succeeded``, ``error``, its settings and each metric by its name."""
        return read_table(self.folder, "runs.parquet", "folder", ())

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of ``summary.json``, such as the grid, its curves, and where each tracker breaks."""
        path = self.folder / "summary.json"
        with reading(f"`folder`: {path}", "summary of a stress test"):
            return read_json(path, "folder")


@dataclass(frozen=True)
class Comparison:
    """A comparison of b with a.

    Attributes:
        outcome: ``worse``, ``no worse`` or ``undecided``, over all metrics that are judged.
        regression: Whether anything is worse by more than the tolerance.
        reasons: Why it is undecided, a sentence each.
        notes: What differs between the sides, how runs were paired, and warnings.
        verdicts: One row for each tracker and metric: both values, the difference, its 95 % interval from ``ci95_low``
            to ``ci95_high``, and the verdict.
    """

    outcome: str
    regression: bool
    reasons: tuple[str, ...]
    notes: tuple[str, ...] = field(repr=False)
    verdicts: pd.DataFrame = field(repr=False)

    def _repr_html_(self) -> str:
        """Return the outcome and what is judged, as notebooks show it."""
        said = "".join(f"<p>{escape(words)}</p>" for words in (self.outcome, *self.reasons, *self.notes))
        return said + self.verdicts[self.verdicts["primary"].astype(bool)].to_html(index=False)


class _OpenOptions(TypedDict, total=False):
    folder: Annotated[Path | str, Option("A folder.")]


class _CompareOptions(TypedDict, total=False):
    a: Annotated[Path | str, Option("A folder, or FOLDER@LABEL.")]
    b: Annotated[Path | str, Option("Likewise.")]
    primary: Annotated[list[str] | None, Option("Keys of metrics.")]
    allow_different: Annotated[bool, Option("Whether different experiments are compared.")]


def _linked(folder: Path) -> str:
    """Return a folder's name, which leads to its page if there is one."""
    page, name = folder / "report.html", escape(str(folder))
    return f'<p><a href="{escape(str(page))}">{name}</a></p>' if page.is_file() else f"<p>{name}</p>"


def run(*, quiet: bool = True, **options: Unpack[RunOptions]) -> Run:
    """Simulate or replay traffic, run sensor and tracker, score the tracks, and write a run folder.

    Args:
        quiet: Whether to leave out the progress bar.
        options: As for the command ``run``; ``settings`` is also a dictionary, ``{"sensor.range_m": 80}``, and
            ``tracker`` also a function that builds one.

    Raises:
        InputError: The input is wrong; nothing is left behind.
        RunError: The run failed part-way; its finished steps are kept in ``NAME.incomplete``.
        RunInterruptedError: It was stopped; likewise.
    """
    with _input_errors():
        config = _run_config(checked(RunOptions, options, "run"))
    arguments = options, _call("run", options), quiet
    named = external_code(config, but_tracker=callable(options.get("tracker")))
    return Run(survived("harness.api:folder_of_run", arguments, named) if named else folder_of_run(*arguments))


def open_run(folder: Path | str) -> Run:
    """Open the folder that a run has left.

    Raises:
        InputError: It is no finished run's folder.
    """
    if folder is None:
        raise InputError("`folder`: give a path or a text, not None")
    path: Path = checked(_OpenOptions, {"folder": folder}, "open_run")["folder"]
    read_manifest(path, "folder")
    return Run(path)


def stress(*, quiet: bool = True, **options: Unpack[GridOptions]) -> Grid:
    """Run many densities, trackers, models and seeds in worker processes, and leave a folder.

    A run that fails is a row of ``Grid.runs`` that says so, and raises nothing.

    Args:
        quiet: Whether to leave out the progress bar.
        options: As for the command ``stress``; lists are lists too, ``densities=[20, 45]``, ``seeds=range(3)``. A
            tracker given as a function must be one that other processes can import by its name.

    Raises:
        InputError: The grid or the folder is wrong; no run was made.
        RunInterruptedError: It was stopped; finished runs are kept.
    """
    return Grid(make_grid(options, _call("stress", options), quiet).folder)


def compare(
    a: Run | Grid | Path | str,
    b: Run | Grid | Path | str,
    *,
    tolerance: float = 0.02,
    time_tolerance: float = 0.25,
    primary: Sequence[str] | None = None,
    allow_different: bool = False,
) -> Comparison:
    """Decide whether b is worse than a, no worse, or whether that stays undecided.

    Args:
        a: A run, a stress test, or the folder of one; one tracker of a stress test as ``FOLDER@LABEL``.
        b: Likewise.
        tolerance: Largest accepted loss, as a share of A's value.
        time_tolerance: Likewise for the time of a step, which is judged between trackers of one stress test.
        primary: Keys of the metrics that get a verdict; None for HOTA in sight, hidden cost, same
            identity, hidden CRPS and the recall in plain view with that of the worst tenth of vehicles.
        allow_different: Whether different experiments are compared too; what differs is in the notes.

    Raises:
        InputError: A folder is not there, or the two have nothing in common that could be compared.
    """
    from harness.analysis import compare as comparing  # noqa: PLC0415
    from harness.analysis import rules, sources  # noqa: PLC0415

    sides = [side.folder if isinstance(side, Run | Grid) else side for side in (a, b)]
    named: dict[str, object] = dict(zip("ab", sides, strict=True))
    if missing := [name for name, side in named.items() if side is None]:
        raise InputError(f"`{missing[0]}`: give a run, a stress test or a folder, not None")
    named |= {"primary": primary, "allow_different": allow_different}
    values = checked(_CompareOptions, named, "compare")
    first, second = str(values["a"]), str(values["b"])
    judged = rules.Rules(tolerance, time_tolerance, rules.PRIMARY if primary is None else tuple(primary))
    compared = comparing.compare(
        sources.open_source(first, "a"), sources.open_source(second, "b"), judged, allow_different
    )
    table = pd.DataFrame(compared.as_table()["verdicts"])
    ends = pd.DataFrame([each or (None, None) for each in table.pop("ci95")], columns=["low", "high"], dtype="float64")
    table[["ci95_low", "ci95_high"]] = ends.to_numpy()
    notes = (*compared.differing, compared.paired, *compared.notes)
    return Comparison(compared.outcome, compared.regression, compared.reasons, notes, table)


def make_run(options: Mapping[str, object], command: str, quiet: bool) -> FinishedRun:
    """Do what ``run`` does.

    Args:
        options: Keywords of ``run``.
        command: What the manifest says of how it was called.
        quiet: Whether to leave out the progress bar.
    """
    with _input_errors():
        values = checked(RunOptions, options, "run")
        if values["resume"] and values["out"] is None:
            raise InputError("`resume`: name the folder of the run; for example `out` results/cam")
        config = _run_config(values)
        # Only now: what is wrong with the input is told before anything heavy is imported.
        from harness.report import page  # noqa: PLC0415
        from harness.running import open as opening  # noqa: PLC0415
        from harness.running import run as running  # noqa: PLC0415

        if values["video"] is not None:
            with drawing("video"):
                video = import_module("harness.report.video")
            video.check_film(values["video"], values["force"])
        if values["gui"]:
            opening.check_gui(config)
        finished = running.run(
            config,
            out=values["out"],
            force=values["force"] and (values["out"] is not None or values["video"] is None),
            resume=values["resume"],
            command=command,
            quiet=quiet,
            draw=running.Drawing(_draw_figures, page.write_run_page),
            open_snapshots=partial(
                opening.open_snapshots, simulate=partial(opening.simulate, gui=values["gui"]), ahead=not values["gui"]
            ),
        )
        if values["video"] is not None:
            with drawing("video"):
                video.write_video(finished.folder, values["video"], values["force"], quiet)
        return finished


def _draw_figures(folder: Path, pictured: object) -> None:
    # Matplotlib may refuse the user's settings of it, which must not end a run.
    import_module("harness.report.pictures").draw_figures(folder, pictured)


def folder_of_run(options: Mapping[str, object], command: str, quiet: bool) -> Path:
    """Return the folder of what ``make_run`` makes."""
    return make_run(options, command, quiet).folder


def _run_config(values: Mapping[str, Any]) -> RunConfig:
    chosen = {name: values[name] for name in keys_of_options()}
    chosen["replay"] = None if values["replay"] is None else str(values["replay"])
    factory = values["tracker"] if callable(values["tracker"]) else None
    if factory is not None:
        chosen["tracker"] = f"{factory.__module__}:{getattr(factory, '__qualname__', type(factory).__name__)}"
    config = resolve_run_config(values["config"], chosen, setting_words(values["settings"]))
    return config if factory is None else config.tracked_by(factory)


def make_grid(options: Mapping[str, object], command: str, quiet: bool) -> FinishedGrid:
    """Do what ``stress`` does; arguments as for ``make_run``."""
    with _input_errors():
        values = checked(GridOptions, options, "stress")
        from harness.grid.request import request_of  # noqa: PLC0415

        request = request_of(values)
        if values["scheduler"] is not None and values["workers"] is not None:
            raise InputError("`workers`: the cluster has its own workers; leave it out with `scheduler`")
        if values["keep"] not in (None, "runs"):
            raise InputError(f"`keep` {values['keep']}: only runs can be kept; for example `keep` runs")
        if values["scheduler"] is not None and values["keep"] is not None:
            raise InputError("`keep`: the cluster's workers may have another disk; leave it out with `scheduler`")
        from harness.grid import making  # noqa: PLC0415
        from harness.grid import stress as stressing  # noqa: PLC0415
        from harness.report import comparison_page, folder_page  # noqa: PLC0415

        user = making.on_stderr(quiet)
        with _execution(values["scheduler"], values["workers"], values["timeout_per_run"]) as execute:
            finished = stressing.run_stress(
                request,
                values["out"],
                execute if values["keep"] is None else making.keeping(execute, Path(values["out"]), user.warn),
                resume=values["resume"] or values["retry_failed"],
                retry_failed=values["retry_failed"],
                user=user,
                command=command,
            )
        if values["keep"] is not None:
            comparison_page.write_kept_pages(finished.folder, quiet)
        folder_page.write_page(finished.folder)
        return finished


@contextmanager
def _execution(scheduler: str | None, workers: int | None, timeout_s: float | None) -> Iterator[RunCells]:
    """Yield what runs the cells: processes of this machine, or a cluster."""
    from harness.grid import cluster, pool  # noqa: PLC0415

    if scheduler is None:
        yield lambda cells, on_row: pool.run_cells(cells, workers or os.cpu_count() or 1, timeout_s, on_row)
        return
    with cluster.connect(scheduler) as client:
        yield lambda cells, on_row: cluster.run_cells_on_cluster(client, cells, timeout_s, on_row)


@contextmanager
def _input_errors() -> Iterator[None]:
    """Turn a name that no registry has into wrong input."""
    try:
        yield
    except UnknownNameError as error:
        raise InputError(str(error)) from None


def _call(name: str, options: Mapping[str, object]) -> str:
    """Return a call as it stands in Python, for the manifest."""
    words = (f"{key}={getattr(value, '__qualname__', None) or shown(value, 10**6)}" for key, value in options.items())
    return f"harness.{name}({', '.join(words)})"
