"""Write docs/tables.md, the reference of the tables' columns, from where they are declared.

A test fails where the committed page is another.

    python .ci/tables_page.py
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from harness.common.markdown import markdown_table
from harness.storage.schema import SCHEMA_VERSION, TABLES, VERSION_KEY, Column, Table

PLACE = Path(__file__).parents[1] / "docs" / "tables.md"
INTRODUCTION = f"""# Tables

The tables that a run and a grid of runs leave, column by column. Where a table says so, trackers get a column or make
it; everything else is for scoring alone. Positions are metres along and across the road; where the road's frame is the
plane, they are x and y.

The key `{VERSION_KEY}` in the metadata of each file, today {SCHEMA_VERSION}, says what its columns mean; a file without
it is of version 1. A program refuses tables of a version that is newer than its own."""


def page(tables: Mapping[str, Table]) -> str:
    """Return the page of some tables."""
    sections = [INTRODUCTION]
    for file, table in tables.items():
        headings = ("column", "type", "unit", "meaning", "trackers")
        shown = len(headings) - (not any(column.trackers for column in table.columns))
        rows = [_row(column)[:shown] for column in table.columns]
        sections.append("\n".join((f"## `{file}`", "", table.meaning, "", *markdown_table(headings[:shown], rows))))
    return "\n\n".join(sections) + "\n"


def _row(column: Column) -> tuple[str, ...]:
    words = ", ".join(f"`{word}`" for word in column.words if word)
    parts = (column.meaning, words and f"one of {words}", column.absent and f"absent where {column.absent}")
    told = "yes" if column.trackers else "no"
    return f"`{column.name}`", column.type, column.unit, "; ".join(filter(None, parts)), told


if __name__ == "__main__":
    PLACE.write_text(page(TABLES), encoding="utf-8")
