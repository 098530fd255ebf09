"""The page of any results folder: a run's own page, or the tables and figures of a study or grid."""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup

from harness.analysis.comparison_text import verdicts_in_grid
from harness.analysis.tables import AXIS_LABELS
from harness.analysis.verdicts import BETTER, NO_WORSE, UNDECIDED, UNTESTED, WORSE
from harness.common.charts import Charts
from harness.common.errors import InputError
from harness.common.untrusted_files import read_text
from harness.report.grid_runs import runs_of
from harness.report.html_tables import html_table
from harness.report.page import chart_parts, embedded, put_page, render, write_run_page
from harness.running.finished import labels
from harness.storage import run_folder as runfolder
from harness.storage.checks import sound_tables
from harness.storage.grid_folder import GRID, RUNS
from harness.storage.schema import NET

PICTURES = (".png", ".svg")
DOCUMENTS = (GRID, runfolder.CONFIG, runfolder.MANIFEST)
OF_SEVERAL_RUNS = (GRID, RUNS, "results.json")
STYLE_OF_VERDICT = {BETTER: "better", WORSE: "worse", NO_WORSE: "same", UNDECIDED: "same", UNTESTED: "same"}
CURVES = "over_"
"""How the names of pictures begin that a grid's charts stand in place of."""
INTERVAL = re.compile(r"([-+\d.]+(?: %)?) (\[[-+\d., ]+\]|\([-+\d.]+ %\))")
MOST_ROWS, MOST_DOCUMENT_LETTERS, MOST_PICTURE_BYTES = 500, 20_000, 8_000_000


def write_page(folder: Path) -> Path:
    """Write ``report.html`` into the folder of a run, stress test, closed loop or study, and return it.

    Raises:
        InputError: It is no such folder, or the run in it did not end or is broken.
    """
    if not folder.is_dir():
        raise InputError(f"`folder`: there is no folder {folder}")
    with sound_tables(folder, "folder"):
        of_several = any((folder / name).is_file() for name in OF_SEVERAL_RUNS)
        if (folder / runfolder.TRUTH).is_file() or (runfolder.is_run_folder(folder) and not of_several):
            return write_run_page(folder)
        if of_several:
            return put_page(folder, folder_page(folder))
    raise InputError(
        f"`folder`: {folder} has no page, as it is no results' folder: a run's holds {runfolder.MANIFEST}, a stress "
        f"test's or closed loop's {GRID}, a study's results.json"
    )


def folder_page(folder: Path) -> str:
    """Return a page with a folder's Markdown texts, pictures, table of runs and settings."""
    texts = [read_text(path) for path in sorted(folder.glob("*.md"))]
    documents = {name: read_text(folder / name) for name in DOCUMENTS if (folder / name).is_file()}
    runs = runs_of(folder)
    by_axis = {} if runs is None else runs.charts
    charts = {"By network" if axis == AXIS_LABELS[NET] else f"Over {axis}": each for axis, each in by_axis.items()}
    return render(
        "folder.html.j2",
        title=title_of(texts) or folder.resolve().name,
        text=Markup("\n").join(as_html(text) for text in texts),
        runs=runs,
        verdicts=as_html(verdicts_in_grid(folder, runs.compared)) if runs is not None else "",
        charts=charts,
        figures=_figures(folder, without=CURVES if charts else None),
        tables=_tables(folder),
        documents={name: text for name, text in documents.items() if len(text) <= MOST_DOCUMENT_LETTERS},
        **chart_parts(list(charts.values())),
    )


def text_page(text: str, charts: Mapping[str, Charts] | None = None, about: str = "") -> str:
    """Return a page that holds a Markdown text, for example that of a comparison, below what it is about and charts."""
    title, charts = title_of([text]) or "Results", charts or {}
    nothing: dict[str, Any] = {"figures": [], "tables": {}, "documents": {}, "runs": None, "verdicts": ""}
    parts = chart_parts(list(charts.values()))
    return render("folder.html.j2", title=title, text=as_html(text), charts=charts, about=about, **nothing, **parts)


def _pictures(folder: Path) -> Iterable[Path]:
    found = sorted(path for path in (*folder.glob("*"), *folder.glob("figures/*")) if path.suffix in PICTURES)
    # One picture may be there in several formats.
    return {path.with_suffix(""): path for path in reversed(found)}.values()


def title_of(texts: Iterable[str]) -> str | None:
    """Return the first heading of Markdown texts."""
    lines = (line for text in texts for line in text.splitlines())
    return next((line.lstrip("#").strip() for line in lines if line.startswith("#")), None)


def as_html(text: str) -> Markup:
    """Return a Markdown text as HTML without its first heading, which is the page's title.

    Its pictures stand with the other figures; HTML in it is shown as text.
    """
    parser = MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")
    lines = [line for line in text.splitlines() if not line.startswith("![")]
    first = next((place for place, line in enumerate(lines) if line.startswith("#")), None)
    if first is not None:
        del lines[first]
    tokens = parser.parse("\n".join(lines))
    _style_cells(tokens)
    tokens = [boxed for token in tokens for boxed in _in_box(token)]
    return Markup(parser.renderer.render(tokens, parser.options, {}))


def _in_box(token: Token) -> list[Token]:
    """Return a token of a table's begin or end with that of a box of its own, in which the table scrolls."""
    if token.type == "table_open":
        begin = "<div class='scroll' tabindex='0' role='group' aria-label='Table'>\n"
        return [Token("html_block", "", 0, content=begin), token]
    return [token, Token("html_block", "", 0, content="</div>\n")] if token.type == "table_close" else [token]


def _style_cells(tokens: Sequence[Token]) -> None:
    """Colour the cells of tables that hold a verdict, and put intervals and percentages below their values."""
    for cell, content in pairwise(tokens):
        if cell.type != "td_open":
            continue
        verdict = content.content.replace("*", "").partition(",")[0]
        if verdict in STYLE_OF_VERDICT:
            cell.attrSet("class", f"verdict {STYLE_OF_VERDICT[verdict]}")
        if found := INTERVAL.fullmatch(content.content):
            below = f"{found[1]}<br><span class='interval-cell'>{found[2]}</span>"
            content.children = [Token("html_inline", "", 0, content=below)]


def _figures(folder: Path, without: str | None = None) -> list[tuple[str, str]]:
    """Return a folder's pictures as data addresses, each with what it shows, for those who do not see it."""
    figures, total = [], 0
    for picture in _pictures(folder):
        if without is not None and picture.name.startswith(without):
            continue
        total += picture.stat().st_size
        if total <= MOST_PICTURE_BYTES:
            figures.append((embedded(picture), picture.stem.replace("_", " ").replace("-", " ")))
    return figures


def _tables(folder: Path) -> dict[str, Markup]:
    path = folder / "runs.parquet"
    if not path.is_file():
        return {}
    runs = runfolder.read_table(folder, path.name, "folder", ()).head(MOST_ROWS)
    shown = [name for name in runs if runs[name].notna().any()]
    table = runs[shown].itertuples(index=False)
    rows = [[f"{value:.4g}" if isinstance(value, float) else str(value) for value in row] for row in table]
    known = labels()
    headings = [_heading(str(name), known.get(str(name))) for name in shown]
    return {"Every run (runs.parquet)": html_table(headings, rows)}


def _heading(key: str, label: str | None) -> str | Markup:
    """Return a column's label with its key below, where it has a label."""
    return key if label is None else Markup("{}<br><span class='key'>{}</span>").format(label, key)
