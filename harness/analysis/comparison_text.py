"""A comparison as Markdown for a comment, and as a coloured table for the terminal."""

import math
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import quote

from rich.console import Group
from rich.table import Table
from rich.text import Text

from harness.analysis.compare import WEIGHTS, Judgement, compare
from harness.analysis.rules import Rules, name_of, quantity_of
from harness.analysis.sources import open_source
from harness.analysis.verdicts import BETTER, NO_WORSE, UNDECIDED, UNTESTED, WORSE, Verdict
from harness.analysis.why import CAUSES, KINDS, TrackFailure, Why, moment_of
from harness.common.errors import InputError
from harness.common.markdown import Terminal, markdown_table
from harness.common.numbers import number
from harness.scoring.metrics.hidden_cost import COST, CRPS, FALSE_HIDDEN

COLOURS = {BETTER: "bold blue", WORSE: "bold red", UNDECIDED: "bold yellow", NO_WORSE: "green"}
HEADINGS = ("metric", "a", "b", "difference", "95 % interval", "p", "pairs", "verdict on b")
MOST_MOMENTS = 20


def conclusion(comparison: Judgement) -> str:
    """Return the outcome in a sentence or two."""
    outcome, judged = comparison.outcome, comparison.primary
    counts = {word: sum(verdict.verdict == word for verdict in judged) for word in (WORSE, UNDECIDED, NO_WORSE, BETTER)}
    told = [f"{count} {word}" for word, count in counts.items() if count or not judged]
    unknown = sum(verdict.primary and verdict.verdict == UNTESTED for verdict in comparison.verdicts)
    of_none = f"; judged but without a value on either side: {unknown}" if unknown else ""
    found = f"Verdicts: {', '.join(told)}{of_none}."
    if outcome == WORSE:
        worse = ", ".join(
            f"{name_of(verdict.metric)}{f' ({verdict.breach})' if verdict.breach else _percent(verdict)}"
            for verdict in judged
            if verdict.regression
        )
        return f"Worse: b is worse in {worse}. {found}"
    if outcome == UNDECIDED:
        return f"Undecided. {found}"
    return f"No worse: b is nowhere worse by more than {_allowed(comparison.rules)}. {found}"


def _allowed(rules: Rules) -> str:
    own = any(limit.tolerance is not None for limit in rules.limits.values())
    usual = f", {100 * rules.tolerance:g} % of a's value ({100 * rules.time_tolerance:g} % for time)"
    return f"the tolerance{'' if own else usual}"


def as_markdown(comparison: Judgement, with_replay: bool = False) -> str:
    """Return the comparison as Markdown; moments lead to the replay where the page has one."""
    lines = [f"## {conclusion(comparison)}", "", *_open(comparison), f"a: `{comparison.a}`, b: `{comparison.b}`", ""]
    lines += [text for line in _basis(comparison) for text in (line, "")]
    for label in dict.fromkeys(verdict.label for verdict in comparison.verdicts):
        verdicts = [verdict for verdict in comparison.verdicts if verdict.label == label]
        lines += [f"### {label}", "", *markdown_table(HEADINGS, map(_marked_cells, verdicts)), ""]
    lines += [*comparison.notes, "", EXPLANATION.format(_allowed(comparison.rules)), ""]
    if comparison.why is not None:
        lines += _why(comparison.why, with_replay)
    return "\n".join(lines)


def verdicts_in_grid(folder: Path, more: Iterable[tuple[str, str]] = ()) -> str:
    """Return the verdicts on each tracker of a stress test against its first, and on more pairs, as Markdown."""
    try:
        first, *others = open_source(str(folder), "folder").labels
        pairs = dict.fromkeys([*((first, other) for other in others), *more])
        sides = {label: open_source(f"{folder}@{label}", "folder") for pair in pairs for label in pair}
        judged = [compare(sides[a], sides[b]) for a, b in pairs]
    except (InputError, ValueError) as error:
        return f"There are no verdicts on these runs, since they can't be compared: {error}"
    rule = f"A verdict allows for {_allowed(Rules())}, and corrects for the number of metrics (not of trackers)."
    lines = [f"{rule} So it may be undecided although an interval excludes 0. {WEIGHTS}"]
    for (a, b), comparison in zip(pairs, judged, strict=True):
        lines += ["", f"a: {a}, b: {b}. {conclusion(comparison)} {comparison.paired}", "", *_open(comparison)]
        lines += markdown_table(HEADINGS, map(_marked_cells, comparison.primary))
    return "\n".join(lines) if pairs else ""


def _basis(comparison: Judgement) -> list[str]:
    """Return what was compared, and what differs between the experiments."""
    return [*([f"These differ: {'; '.join(comparison.differing)}."] if comparison.differing else []), comparison.paired]


def print_comparison(comparison: Judgement) -> None:
    """Print the verdict and the metrics that it rests on, on stderr; the others are in the files."""
    sides = (f"a: {comparison.a}", f"b: {comparison.b}")
    parts: list[Table | Text] = [Text("\n".join((*_open(comparison), *sides, *_basis(comparison))))]
    labels = dict.fromkeys(verdict.label for verdict in comparison.verdicts if verdict.primary)
    parts += [_screen_table(comparison, label) for label in labels]
    if comparison.why is not None:
        parts.append(_screen_causes(comparison.why))
    others = len({each.metric for each in comparison.verdicts if not _is_on_screen(each, comparison)})
    more = [f"Other metrics, not judged: {others}; --html FILE and --markdown FILE show them."] if others else []
    parts += [Text(note) for note in (*more, *comparison.notes)]
    told = Text(f"\n{conclusion(comparison)}", style=COLOURS[comparison.outcome])
    Terminal(stderr=True, highlight=False).print(Group(told, *parts))


def _open(comparison: Judgement) -> list[str]:
    """Return why nothing may be concluded as a paragraph in Markdown; nothing where something may be."""
    return [" ".join(comparison.reasons), ""] if comparison.outcome == UNDECIDED else []


EXPLANATION = (
    "Differences are b minus a with Student's 95 % intervals over seeds, or over vehicles where there is one seed. "
    "*Worse*: the one-sided p, corrected for the number of verdicts by Holm's method, is at most 0.05, and the "
    "difference exceeds {}. The interval is two-sided, so it may still contain 0. *Better*: the same p for "
    "an improvement is at most 0.05. *No worse*: no value in the interval is worse by more than the tolerance. "
    "*Undecided*: none of these. Metrics that were not named beforehand are described, not tested."
)
CAUSES_NOTE = (
    "The cause of a failure is what happened to the vehicle's previous track. *Death*: it ended alone. *Merge*: it "
    "ended beside another track. *Association*: it continues on another vehicle, or an older track replaced it in "
    "view. *Birth*: a newer track replaced it in view. *Re-identification*: the vehicle returned with another identity."
)


def _is_on_screen(verdict: Verdict, comparison: Judgement) -> bool:
    return verdict.primary or (verdict.metric == FALSE_HIDDEN and not {COST, CRPS}.isdisjoint(comparison.rules.primary))


def _screen_table(comparison: Judgement, label: str) -> Table:
    """Return what fits 80 columns of what is judged, and of false hidden tracks beside judged hidden vehicles."""
    rows = []
    for verdict in (each for each in comparison.verdicts if each.label == label and _is_on_screen(each, comparison)):
        name, a, b, difference, interval, _, pairs, word = cells(verdict)
        told = word if verdict.primary and word != UNTESTED else "-"
        rows.append((name, a, b, difference.partition(" ")[0], interval, pairs, told))
    table = Table(title=f"{label}; n pairs", box=None, title_justify="left", padding=(0, 1, 0, 0), pad_edge=False)
    for place, heading in enumerate(("metric", "a", "b", "b - a", "95 % interval", "n", "b is")):
        # Of what does not fit, names give way, never numbers.
        width = max((len(row[place]) for row in rows), default=0) if place else None
        table.add_column(heading, justify="left" if place in (0, 6) else "right", no_wrap=place > 0, min_width=width)
    for *others, word in rows:
        table.add_row(*others, Text(word, style=COLOURS.get(word, "")))
    return table


def _screen_causes(why: Why) -> Table:
    heading, *rows = _causes(why)
    table = Table(
        title="Causes of switches and lost hidden tracks, counts", box=None, title_justify="left", padding=(0, 2, 0, 0)
    )
    for place, name in enumerate(heading):
        table.add_column(name, justify="right" if place else "left", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def _causes(why: Why) -> list[list[str]]:
    """Return the table of causes with its heading: one line for each kind and run, which its causes sum up to."""
    counts = why.counts()
    lines = [["", *CAUSES, "all"]]
    for kind in KINDS:
        for side, of_side in counts.items():
            lines.append([f"{kind}, {side}", *map(str, of_side[kind].values()), str(sum(of_side[kind].values()))])
    return lines


def _why(why: Why, with_replay: bool) -> list[str]:
    """Return causes and moments as Markdown; each moment leads into the run's replay, or into that of the page."""

    def address(folder: str, failure: TrackFailure) -> str:
        return f"{'' if with_replay else f'{quote(folder)}/report.html'}{moment_of(failure)}"

    heading, *rows = _causes(why)
    lines = ["### Why", "", CAUSES_NOTE, "", *markdown_table(heading, rows), ""]
    for side, found, folder in (("a", why.a, why.folder_a), ("b", why.b, why.folder_b)):
        moments = [
            [f"[{each.time_s:.1f} s]({address(folder, each)})", each.kind, each.cause, each.vehicle_id]
            for each in found[:MOST_MOMENTS]
        ]
        more = f", the first {MOST_MOMENTS} of {len(found)}" if len(found) > MOST_MOMENTS else ""
        if moments:
            lines += [f"Moments of {side}{more}:", ""]
            lines += [*markdown_table(("moment", "what", "cause", "vehicle"), moments), ""]
    return lines


def _marked_cells(verdict: Verdict) -> list[str]:
    *others, word = cells(verdict)
    why = f", {verdict.wanting or 'the interval does not decide'}" if word == UNDECIDED else ""
    return [*others, f"**{word}**{why}" if word in COLOURS else word]


def cells(verdict: Verdict) -> list[str]:
    """Return a verdict's row below ``HEADINGS``."""
    quantity = quantity_of(verdict.metric)
    decimals = quantity.decimals + 1
    low, high = (number(end, decimals, sign="+") for end in verdict.ci95)
    return [
        quantity.label,
        number(verdict.a, decimals),
        number(verdict.b, decimals),
        number(verdict.difference, decimals, sign="+") + _percent(verdict),
        "-" if math.isnan(verdict.ci95[0]) else f"{low} to {high}",
        "< 0.001" if verdict.p < 0.0005 else number(verdict.p, 3),
        str(verdict.pairs),
        verdict.verdict,
    ]


def _percent(verdict: Verdict) -> str:
    if not verdict.a or math.isnan(verdict.difference):
        return ""
    return f" ({100.0 * verdict.difference / abs(verdict.a):+.1f} %)"
