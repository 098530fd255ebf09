"""Tables in Markdown, and Markdown on a screen."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.markdown import Markdown


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table."""

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cells) + " |"

    return [line(headings), line(["---"] * len(headings)), *(line(row) for row in rows)]


def show_markdown(text: str, on_stderr: bool = False) -> None:
    """Print a Markdown text: laid out where a person reads it, as it is where a file or a program does."""
    stream = sys.stderr if on_stderr else sys.stdout
    if not stream.isatty():
        stream.write(text + "\n")
        return

    shown = "\n".join(line for line in text.splitlines() if not line.startswith("!["))
    Console(file=stream, highlight=False).print(Markdown(shown))
