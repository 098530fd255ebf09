"""The settings as tables in the terminal, one for each group."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from rich.console import Console, Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from harness.settings.listing import Setting

WIDEST, WIDEST_UNIT = 130, 12


def print_settings(rows: Sequence[Setting]) -> None:
    """Print settings on stdout: for each group its path and kind, and below it a line for each setting."""
    console = Console(highlight=False)
    console.width = min(console.width, WIDEST) if console.is_terminal else WIDEST
    cells = [(_name(row.key), _default(row), row.unit) for row in rows]
    name, default, unit = (max(len(cell) for cell in column) for column in zip(*cells, strict=True))
    for (kind, group), members in groupby(rows, key=lambda row: (row.kind, _group(row.key))):
        table = Table.grid(padding=(0, 2, 0, 0))
        for width in (name, default, min(unit, WIDEST_UNIT), None):
            table.add_column(width=width, overflow="fold")
        for row in members:
            table.add_row(_name(row.key), _default(row), row.unit, row.meaning)
        heading = Text.assemble((group or "at the top", "bold"), f"  {kind}")
        console.print(Group(heading, Padding(table, (0, 0, 1, 2), expand=False)))


def _group(key: str) -> str:
    """Return what stands before the setting's own name, or the key that a named thing is for."""
    before, equals, _ = key.partition("=")
    return before if equals else key.rpartition(".")[0]


def _name(key: str) -> str:
    return key[len(_group(key)) :].lstrip(".=")


def _default(row: Setting) -> str:
    if row.default is None:
        return "" if "=" in row.key else "-"
    if isinstance(row.default, bool):
        return str(row.default).lower()
    return f"{row.default:.6g}" if isinstance(row.default, float) else str(row.default)
