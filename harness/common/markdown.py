"""Writes Markdown pages and tables, and shows Markdown in the terminal."""

import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.markdown import Markdown
from rich.segment import Segment
from rich.table import Table

from harness.common.streams import without_controls

INTERVAL = re.compile(r"([-+\d.,]+(?: %)?) (\[[-+\d., ]+\])")
"""A value with its interval, which goes on a line of its own in a narrow column."""
WIDEST_NAME, MOST_NAMES = 32, 3
PagePart = str | Sequence[str]
"""A part of a page: a text, or the lines of a list or table."""


class Terminal(Console):
    """A console that takes the control characters from texts, which others may have named."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """Yield the parts of what is printed."""
        for part in super().render(renderable, options):
            yield part if part.control else part._replace(text=without_controls(part.text))


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table."""

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cells) + " |"

    return [line(headings), line(["---"] * len(headings)), *(line(row) for row in rows)]


def markdown_page(parts: Iterable[PagePart]) -> str:
    """Return a page of parts with empty lines between them."""
    return "\n\n".join(part if isinstance(part, str) else "\n".join(part) for part in parts) + "\n"


def show_markdown(text: str, on_stderr: bool = False) -> None:
    """Print a Markdown text: formatted on stderr and on a terminal, raw where a program or a file reads stdout."""
    stream = sys.stderr if on_stderr else sys.stdout
    if not on_stderr and not stream.isatty():
        stream.write(without_controls(text) + "\n")
        return
    console = Terminal(file=stream, highlight=False)
    lines = (line for line in text.splitlines() if not line.startswith("!["))
    for is_table, group in groupby(lines, key=lambda line: line.startswith("|")):
        block = list(group)
        parts = _tables(block, console.width) if is_table else [Markdown("\n".join(block))]
        for part in parts:
            console.print(part)


def _tables(lines: Sequence[str], width: int) -> Iterator[Table]:
    """Yield a Markdown table as as many tables as the width needs; each begins with what tells the rows apart."""
    rows = [[_cell(cell) for cell in line.strip("| ").split(" | ")] for line in lines if not line.startswith("| ---")]
    columns = list(zip(*rows, strict=True))
    first = next((n for n in range(1, MOST_NAMES + 1) if len(set(zip(*columns[:n], strict=True))) == len(rows)), 1)
    names, columns = columns[:first], columns[first:]
    name_widths = [min(max(map(_width, column)), WIDEST_NAME) for column in names]
    room = width - sum(name_widths) - 2 * first - 1
    while columns:
        taken, used = 0, 0
        while taken < len(columns) and (used + _column_width(columns[taken]) <= room or not taken):
            used += _column_width(columns[taken])
            taken += 1
        part, columns = columns[:taken], columns[taken:]
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
        for column, name_width in zip(names, name_widths, strict=True):
            table.add_column(column[0], overflow="fold", width=name_width)
        for heading, *cells in part:
            is_text = any(cell[:1].isalpha() for cell in cells)
            table.add_column(
                heading, justify="left" if is_text else "right", width=_column_width((heading, *cells)) - 2
            )
        for row in list(zip(*names, *part, strict=True))[1:]:
            table.add_row(*row)
        yield table


def _cell(cell: str) -> str:
    plain = re.sub(r"\[([^]]+)\]\([^)]*\)|[*`]", r"\1", cell.strip())
    found = INTERVAL.fullmatch(plain)
    return f"{found[1]}\n\\{found[2]}" if found else plain.replace("[", "\\[")


def _width(cell: str) -> int:
    return max(len(line.replace("\\[", "[")) for line in cell.split("\n"))


def _column_width(column: Sequence[str]) -> int:
    """Return how wide a column is whose heading may break between words."""
    return 2 + max(max(map(len, column[0].split()), default=0), *map(_width, column[1:]), 0)
