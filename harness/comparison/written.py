"""A comparison as Markdown for a comment, and as a coloured table for the screen."""

from __future__ import annotations

import math

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from harness.comparison.compare import Comparison
from harness.comparison.verdicts import BETTER, WORSE, Verdict, compared_quantities
from harness.writing.markdown import markdown_table

COLOURS = {BETTER: "bold blue", WORSE: "bold red"}
HEADINGS = ("metric", "a", "b", "difference", "95 % interval", "p", "pairs", "verdict on b")


def conclusion(comparison: Comparison) -> str:
    """Return the outcome in a sentence."""
    counts = {word: sum(verdict.verdict == word for verdict in comparison.verdicts) for word in (BETTER, WORSE)}
    regressions = sum(verdict.regression for verdict in comparison.verdicts)
    found = f"{counts[BETTER]} metrics better, {counts[WORSE]} worse, of {len(comparison.verdicts)}"
    if regressions:
        return f"Regression: {found}; {regressions} beyond the tolerance of {100 * comparison.tolerance:g} %."
    if comparison.reasons:
        return f"Undecided for want of data: {found}. {' '.join(comparison.reasons)}"
    return f"No regression: {found}."


def as_markdown(comparison: Comparison) -> str:
    """Return the comparison as Markdown."""
    lines = [f"## {conclusion(comparison)}", "", f"a: `{comparison.a}`, b: `{comparison.b}`", ""]
    for label in dict.fromkeys(verdict.label for verdict in comparison.verdicts):
        verdicts = [verdict for verdict in comparison.verdicts if verdict.label == label]
        lines += [f"### {label}", "", *markdown_table(HEADINGS, map(_marked_cells, verdicts)), ""]
    return "\n".join([*lines, *comparison.notes, "", EXPLANATION, ""])


def print_comparison(comparison: Comparison) -> None:
    """Print the comparison on stderr."""
    parts: list[Table | Text] = [Text(f"\na: {comparison.a}\nb: {comparison.b}")]
    labels = dict.fromkeys(verdict.label for verdict in comparison.verdicts)
    parts += [_screen_table(comparison, label) for label in labels]
    parts += [Text(note) for note in comparison.notes]
    style = "bold red" if comparison.regression else "bold yellow" if comparison.reasons else "bold"
    Console(stderr=True, highlight=False).print(Group(*parts, Text(conclusion(comparison), style=style)))


EXPLANATION = (
    "Differences are b minus a, with bootstrap intervals; p is that of an exact permutation test, corrected for the "
    "number of metrics and trackers by Holm's method, so that any false verdict has a probability of at most 5 %."
)
REGRESSION = ", regression"


def _screen_table(comparison: Comparison, label: str) -> Table:
    """Return what fits 80 columns: all but p and the number of pairs."""
    table = Table(title=label, box=None, title_justify="left", padding=(0, 2, 0, 0))
    for place, heading in enumerate(("metric", "a", "b", "b - a", "95 % interval", "b is")):
        table.add_column(heading, justify="left" if place in (0, 5) else "right", no_wrap=True)
    for verdict in (verdict for verdict in comparison.verdicts if verdict.label == label):
        name, a, b, _, interval, *_ = _cells(verdict)
        word = Text(verdict.verdict, style=COLOURS.get(verdict.verdict, ""))
        table.add_row(name.rpartition(",")[0] or name, a, b, _percent(verdict).strip(" ()"), interval, word)
    return table


def _marked_cells(verdict: Verdict) -> list[str]:
    *cells, word = _cells(verdict)
    return [*cells, f"**{word}**" if verdict.verdict in COLOURS else word]


def _cells(verdict: Verdict) -> list[str]:
    quantity = next(each for each in compared_quantities() if each.key == verdict.metric)
    decimals = quantity.decimals + 1
    low, high = (_number(end, decimals, True) for end in verdict.ci95)
    return [
        quantity.label,
        _number(verdict.a, decimals),
        _number(verdict.b, decimals),
        _number(verdict.difference, decimals, True) + _percent(verdict),
        "-" if math.isnan(verdict.ci95[0]) else f"{low} to {high}",
        "-" if math.isnan(verdict.p) else f"{verdict.p:.3f}",
        str(verdict.pairs),
        verdict.verdict + (REGRESSION if verdict.regression else ""),
    ]


def _number(value: float, decimals: int, signed: bool = False) -> str:
    if math.isnan(value):
        return "-"
    return f"{value:+.{decimals}f}" if signed else f"{value:.{decimals}f}"


def _percent(verdict: Verdict) -> str:
    if not verdict.a or math.isnan(verdict.difference):
        return ""
    return f" ({100.0 * verdict.difference / abs(verdict.a):+.1f} %)"
