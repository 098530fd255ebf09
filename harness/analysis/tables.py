"""The tables of a grid: Markdown for a file, rich text for the terminal."""

import shlex
import sys
from collections.abc import Collection, Sequence

from harness.analysis.coasting_ratio import COASTING_TRACKER
from harness.analysis.curves import BREAK_PERCENT, FEWEST_EVENTS, Break, Point, curve_quantities, table_quantities
from harness.analysis.mismatch_cost import STOPPED, STOPPED_NOTE
from harness.analysis.pooled import Mean
from harness.common.markdown import PagePart, markdown_page, markdown_table, show_markdown
from harness.scoring.metrics.quantity import Quantity
from harness.scoring.metrics.registry import is_from_outside, quantities
from harness.storage.schema import NET

NAMES = {NET: "network"}


def heading_of(axis: str) -> str:
    """Return what stands over the tables of an axis."""
    return "By network" if axis == NET else f"Over {axis}"


def as_markdown(title: str, points: Sequence[Point], broken: Sequence[Break], failures: Sequence[str]) -> str:
    """Return all curves as tables with 95 % intervals over seeds, where each tracker breaks, and what failed."""
    parts: list[PagePart] = [f"# {title}", f"Means over seeds with 95 % intervals over seeds. {HOTA_NOTE}"]
    if broken:
        parts += ["## Where each tracker breaks", [f"- {break_sentence(at)}" for at in broken], DEFINITION]
    for axis in dict.fromkeys(point.axis for point in points):
        parts += [f"## {heading_of(axis)}"]
        for heading, columns in _themes({point.metric for point in points}):
            parts += [heading, table := _table(points, axis, columns, BY_KIND.get(heading))]
            parts += [STOPPED_NOTE] if STOPPED in table[0] else []
    if failures:
        parts += ["## Runs that failed", [f"- {failure}" for failure in failures]]
    return markdown_page(parts)


def _table(points: Sequence[Point], axis: str, columns: Sequence[Quantity], kinds: tuple[str, str] | None) -> list[str]:
    """Return a table with a row for each tracker and place, and for each kind that has values."""
    start = ["tracker", NAMES.get(axis, axis)]
    if kinds is None:
        labels = [column.label for column in columns]
        return markdown_table([*start, *labels, "seeds"], _rows(points, axis, columns, True))
    heading, words = kinds
    shown = dict.fromkeys(_score(column) for column in columns)
    label_of = {_score(column): column.label.replace(f"{words}{_kind(column)}", "") for column in columns}
    found = {(_kind(column), _score(column)): column for column in columns}
    known = {kind: [found[kind, score] for score in shown if (kind, score) in found] for kind, _ in found}
    by_kind: list[tuple[int, list[str]]] = []
    for kind, of_kind in known.items():
        scores = [_score(column) for column in of_kind]
        for place, row in enumerate(_rows(points, axis, of_kind, True)):
            cells = dict(zip(scores, row[2:-1], strict=True))
            if any(cell != "-" for cell in cells.values()):
                told = [cells.get(score, "-") for score in shown]
                by_kind.append((place, [*row[:2], kind, *told, row[-1]]))
    rows = [row for _, row in sorted(by_kind, key=lambda each: each[0])]
    return markdown_table([*start, heading, *(label_of[score] for score in shown), "seeds"], rows)


def _kind(quantity: Quantity) -> str:
    return quantity.key.split(".")[1]


def _score(quantity: Quantity) -> str:
    return quantity.key.split(".", 2)[2]


def print_result(
    title: str, points: Sequence[Point], broken: Sequence[Break], failures: Sequence[str], place: str
) -> None:
    """Print the same in short on stderr."""
    lines, known = [f"# {title}", ""], {point.metric for point in points}
    shown = [quantity for quantity in curve_quantities() if not quantity.is_of_some_runs or quantity.key in known]
    for axis in dict.fromkeys(point.axis for point in points):
        name = NAMES.get(axis, axis)
        # In one column, which every part of a table that is wider than the screen begins with.
        headings = [f"tracker, {name.rpartition('.')[2]}", *(each.heading or each.label for each in shown)]
        rows = [[f"{row[0]}, {row[1]}", *row[2:-1]] for row in _rows(points, axis, shown, False)]
        lines += [f"Means over seeds, by {name}:", "", *markdown_table(headings, rows), ""]
    lines += [f"- {line}" for line in (*map(break_sentence, broken), *(f"failed: {each}" for each in failures[:10]))]
    labels = list(dict.fromkeys(point.label for point in points))
    show_markdown("\n".join([*lines, "", WEIGHTS_NOTE, "", HOTA_NOTE, "", f"Results: {place}"]), on_stderr=True)
    if len(labels) > 1:
        # Not wrapped, so that it can be copied.
        pair = " ".join(shlex.quote(f"{place}@{label}") for label in labels[:2])
        sys.stderr.write(f"For verdicts on two of them, run: python -m harness compare {pair}\n")


WEIGHTS_NOTE = (
    "Means over vehicle-steps or occlusions weigh runs by the number of these. `compare` counts each run the same, "
    "except in rates a kilometre, so its means may differ."
)
HOTA_NOTE = (
    "HOTA is by position (similarity falls to 0 at 8 m along the road and 4 m across), not by overlap of boxes, so "
    "it differs from that of other programs (docs/explanation/scores.md)."
)
DEFINITION = (
    f"A tracker breaks where, with growing density, fewer than {BREAK_PERCENT:g} % of the occluded vehicles have their "
    "old identity again half a second after they are seen again; pooled over seeds, interpolated between densities."
)


def break_sentence(entry: Break) -> str:
    """Return a sentence on where a tracker breaks."""
    if entry.held_to is None:
        return f"{entry.label}: fewer than {FEWEST_EVENTS} occlusions at each density, too few to say where it breaks"
    kept = f"{BREAK_PERCENT:g} % of the identities after occlusions"
    if entry.density is None:
        return f"{entry.label}: up to {entry.held_to:g} veh/km/lane, keeps at least {kept}"
    where = f"{entry.label}: from {entry.density:.0f} veh/km/lane on, keeps fewer than {kept}"
    if entry.at_lowest or entry.ci95 is None:
        return where
    low, high = (f"{end:.0f}" if end is not None else "beyond the grid" for end in entry.ci95)
    return f"{where} (95 % interval {low} to {high})"


HIDDEN_NOTE = (
    "Hidden vehicles that were seen before, 10 m where no track follows, and hidden tracks that follow no vehicle "
    "(docs/explanation/scores.md):"
)
FOLLOWED_NOTE = (
    "Errors while followed, each with the share of vehicle-steps that it is over; then on the vehicle-steps that both "
    f"the tracker and constant-velocity prediction ({COASTING_TRACKER}, with the true association) follow:"
)
REST_NOTE = "Identities, HOTA, GOSPA and computing time:"
TRUST_NOTE = "Stated and observed uncertainty; that of existence is of all seeds together (docs/explanation/scores.md):"
DECISION_NOTE = "Decisions of a driver who relies on the tracks:"
MANOEUVRE_NOTE = "By what vehicles do (docs/explanation/scores.md):"
CAUSE_NOTE = "By what hides vehicles, other vehicles or walls of buildings (docs/explanation/scores.md):"
ROUTE_NOTE = (
    "Vehicles that turned while hidden for 2 s or more: is their track on the way that they drove, when they are seen "
    "again and just before?"
)
PLAIN_NOTE = "Vehicles in plain view within 60 m, detected or not: do they have a track (docs/explanation/scores.md)?"
OWN_NOTE = "Your own metrics:"
PSEUDO_NOTE = "Vehicles hidden on purpose, when the time ends (docs/explanation/scores.md):"
THEMES = {
    **dict.fromkeys(("hidden", "gospa_remembered"), HIDDEN_NOTE),
    **dict.fromkeys(("mae", "against_coasting"), FOLLOWED_NOTE),
    **dict.fromkeys(("calibration", "existence_calibration", "never_seen"), TRUST_NOTE),
    "decisions": DECISION_NOTE,
    "manoeuvre": MANOEUVRE_NOTE,
    "hidden_by": CAUSE_NOTE,
    "in_plain_view": PLAIN_NOTE,
    "unseen_turns": ROUTE_NOTE,
    "pseudo_occlusion": PSEUDO_NOTE,
}
BY_KIND = {MANOEUVRE_NOTE: ("vehicles", ", "), CAUSE_NOTE: ("behind", ", behind a ")}
"""Tables with a row for each kind, the second word of keys: the kinds' heading, and what precedes a kind in labels."""


def _themes(metrics: Collection[str]) -> list[tuple[str, list[Quantity]]]:
    """Return the columns of each table with what stands over it; of optional ones those among the given metrics."""
    themes: dict[str, list[Quantity]] = {HIDDEN_NOTE: [], FOLLOWED_NOTE: [], REST_NOTE: []}
    added = {quantity.metric for quantity in quantities() if is_from_outside(quantity)}
    for quantity in table_quantities():
        if not quantity.is_of_some_runs or quantity.key in metrics:
            note = OWN_NOTE if quantity.metric in added else THEMES.get(quantity.metric, REST_NOTE)
            themes.setdefault(note, []).append(quantity)
    return list(themes.items())


def _rows(points: Sequence[Point], axis: str, columns: Sequence[Quantity], with_intervals: bool) -> list[list[str]]:
    places = dict.fromkeys((point.label, point.value) for point in points if point.axis == axis)
    rows = []
    for label, value in places:
        here = {
            point.metric: point for point in points if (point.axis, point.label, point.value) == (axis, label, value)
        }
        cells = [value_cell(here[each.key], each.decimals, with_intervals) for each in columns]
        place = value if isinstance(value, str) else f"{value:g}"
        rows.append([label, place, *cells, str(max(point.seeds for point in here.values()))])
    return rows


def value_cell(point: Point | Mean, decimals: int, with_interval: bool = True) -> str:
    """Return a mean with its interval, as far as there is one."""
    if point.mean is None:
        return "-"
    text = f"{point.mean:.{decimals}f}"
    if with_interval and point.ci95 is not None:
        text += f" [{point.ci95[0]:.{decimals}f}, {point.ci95[1]:.{decimals}f}]"
    return text


AXIS_LABELS = {"density": "density, vehicles per km and lane", "demand": "demand", NET: NAMES[NET]}
