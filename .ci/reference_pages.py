"""Write the pages of docs/reference that list what the code declares: commands, settings, tables, metrics, and others.

A test fails where a committed page differs.

    python .ci/reference_pages.py
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import is_dataclass
from importlib import import_module
from itertools import groupby
from pathlib import Path
from typing import get_args, get_type_hints

from typer.core import TyperArgument
from typer.main import get_group

from harness.commands.app import PANELS, application
from harness.commands.settings_table import all_settings, default_text
from harness.common.exit_codes import MEANINGS
from harness.common.markdown import markdown_table
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.quantity import Quantity
from harness.scoring.metrics.registry import METRICS, completed
from harness.storage.schema import SCHEMA_VERSION, TABLES, VERSION_KEY, Column, Table

PLACE = Path(__file__).parents[1] / "docs" / "reference"
WITH_PARTS = {"evidence", "evidence.rows"}
"""What of a metric's evidence has parts with sections of their own."""
GENERATED = "<!-- Written by .ci/reference_pages.py. -->"


def commands_page() -> str:
    """Return the page of all commands with their options."""
    sections = [
        "# Commands",
        "Every command also takes `--help`. Lists have commas between values.",
    ]
    for panel, commands in PANELS.items():
        sections.append(f"## {panel}")
        sections.extend(_command(name) for name in commands)
    return _joined(sections)


def _command(name: str) -> str:
    command = get_group(application(name)).commands[name]
    summary, *paragraphs = inspect.cleandoc(command.help or "").split("\n\n")
    rows = []
    for option in command.params:
        word = (option.name or "").upper() if isinstance(option, TyperArgument) else ", ".join(option.opts)
        rows.append((f"`{word}`", _cell(getattr(option, "help", None) or "")))
    text = [f"### {name}", summary]
    for paragraph in paragraphs:
        title, *lines = paragraph.split("\n")
        code = title.endswith(":") and all(line.startswith("  ") for line in lines)
        text.append("\n".join((title, "", "```sh", *(line[2:] for line in lines), "```")) if code else paragraph)
    return "\n\n".join([*text, "\n".join(markdown_table(("option", "meaning"), rows))])


def settings_page() -> str:
    """Return the page of all settings."""
    sections = [
        "# Settings",
        "What `config.toml` holds, and `--set KEY=VALUE` changes. `python -m harness settings WORD` prints those that "
        "contain a word.",
    ]
    for kind, rows in groupby(all_settings(), key=lambda row: row.kind):
        cells = [(f"`{row.key}`", _cell(default_text(row)), row.unit, _cell(row.meaning)) for row in rows]
        table = markdown_table(("key", "default", "unit", "meaning"), cells)
        sections.append("\n".join((f"## {kind}", "", *table)))
    return _joined(_merged(sections))


def _merged(sections: list[str]) -> Iterator[str]:
    """Number the headings of groups that come more than once, so that each has its own link."""
    seen: dict[str, int] = {}
    for section in sections:
        heading, _, rest = section.partition("\n")
        seen[heading] = seen.get(heading, 0) + 1
        yield section if seen[heading] == 1 else f"{heading} ({seen[heading]})\n{rest}"


def tables_page(tables: Mapping[str, Table] = TABLES) -> str:
    """Return the page of the tables' columns."""
    sections = [
        "# Tables",
        "The tables of a run and of a stress test, column by column. The last column says what trackers get or make; "
        "everything else is for scoring alone. Positions are metres along and across the road; on plane roads they are "
        "x and y.",
        f"The key `{VERSION_KEY}` in the metadata of each file, today {SCHEMA_VERSION}, says what its columns mean. A "
        "file without it has version 1. Tables of a newer version are refused.",
    ]
    for file, table in tables.items():
        headings = ("column", "type", "unit", "meaning", "trackers")
        shown = len(headings) - (not any(column.trackers for column in table.columns))
        rows = [_column(column)[:shown] for column in table.columns]
        sections.append("\n".join((f"## `{file}`", "", table.meaning, "", *markdown_table(headings[:shown], rows))))
    return _joined(sections)


def _column(column: Column) -> tuple[str, ...]:
    words = ", ".join(f"`{word}`" for word in column.words if word)
    parts = (column.meaning, words and f"one of {words}", column.absent and f"absent where {column.absent}")
    told = "yes" if column.trackers else "no"
    return f"`{column.name}`", column.type, column.unit, _cell("; ".join(filter(None, parts))), told


def metrics_page() -> str:
    """Return the page of the keys of ``metrics.json``."""
    sections = [
        "# Keys of metrics.json",
        "Scores in percent unless a unit is named. A score without samples is null. How scores are defined: "
        "[scores](../explanation/scores.md).",
    ]
    empty = completed({})
    for name, metric in METRICS.in_order().items():
        score = getattr(metric.score, "total", metric.score)
        keys = [f"`{key}`" for key in _keys(name, empty.get(name, {}))]
        rows = [(f"`{each.key}`", _cell(_meaning(each)), each.better) for each in metric.quantities]
        shown = markdown_table(("key", "shown as", "better is"), rows) if rows else []
        parts = [f"## {name}", _explained(inspect.getdoc(score) or ""), "\n".join(shown), _listed(keys)]
        sections.append("\n\n".join(part for part in parts if part))
    return _joined(sections)


def _keys(path: str, value: object) -> Iterator[str]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _keys(f"{path}.{key}", inner)
    else:
        yield f"{path}[]" if isinstance(value, list) else path


def _listed(keys: list[str]) -> str:
    return f"All keys: {', '.join(keys)}." if keys else "Its keys depend on the road."


def _explained(docstring: str) -> str:
    """Return the parts of a docstring that say what is computed and returned, as Markdown."""
    parts = re.split(r"\n(?=\w+:\n)", docstring.replace("``", "`"))
    returned = [inspect.cleandoc(part.partition("\n")[2]) for part in parts[1:] if part.startswith("Returns:")]
    return "\n\n".join([parts[0].strip(), *returned])


def evidence_page() -> str:
    """Return the page of what a metric gets."""
    sections = [
        "# What a metric gets",
        "The function of a [metric](../how-to/metric.md) gets an `Evidence`. These are its attributes. Arrays of one "
        "section have one entry for each of its rows, and a *row* in a name is an index into another section's rows. "
        "`error_table` is a data frame with the columns of `errors.parquet` ([tables](tables.md)).",
        *_attributes("evidence", Evidence, {}),
    ]
    return _joined(sections)


def _attributes(path: str, kind: type, known: dict[str, str]) -> Iterator[str]:
    """Yield a section of a class's attributes, then those of its attributes that are classes of arrays too."""
    about, meanings = _meanings(kind)
    columns = {column.name: column.meaning for table in TABLES.values() for column in reversed(table.columns)}
    rows, inner, known[kind.__name__] = [], [], path
    for name, hint in get_type_hints(kind).items():
        own = next((each for each in (hint, *get_args(hint)) if is_dataclass(each)), None)
        meaning = meanings.get(name) or columns.get(name) or (own and _meanings(own)[0].split(". ")[0]) or ""
        if path in WITH_PARTS and own is not None:
            inner += [] if own.__name__ in known else [(f"{path}.{name}", own)]
            meaning = f"{meaning} Like `{known[own.__name__]}`" if own.__name__ in known else meaning
            known.setdefault(own.__name__, f"{path}.{name}")
        told = _cell(_resolved(meaning, kind, known)).rstrip(".")
        rows.append((f"`{name}`", told[:1].upper() + told[1:]))
    table = markdown_table(("attribute", "meaning"), rows)
    yield "\n".join((f"## `{path}`", "", _resolved(about, kind, known), "", *table))
    for place, own in inner:
        yield from _attributes(place, own, known)


def _resolved(text: str, kind: type, known: Mapping[str, str]) -> str:
    """Return a text with sections in place of classes' names, and constants with their values."""

    def told(match: re.Match[str]) -> str:
        place, _, name = match[1].rpartition(".")
        value = getattr(import_module(place or kind.__module__), name) if name.isupper() else None
        if isinstance(value, tuple):
            return f"`{value}`"
        if isinstance(value, int | float):
            return f"{value:g} {name.rpartition('_')[2].lower()}"
        return f"`{known[place]}.{name}`" if place in known else f"`{known.get(name, match[1])}`"

    return re.sub(r"`([\w.]+)`", told, text.replace(", see `harness.scoring.evidence.errors.error_table`", ""))


def _meanings(kind: type) -> tuple[str, dict[str, str]]:
    """Return what a class's docstring says of it, in Markdown, and of each of its attributes."""
    about, _, listed = (inspect.getdoc(kind) or "").replace("``", "`").partition("\n\nAttributes:\n")
    return about, dict(re.findall(r"^    (\w+): (.*(?:\n      .*)*)", listed, flags=re.MULTILINE))


def exit_codes_page() -> str:
    """Return the page of exit codes."""
    rows = [(str(code), meaning) for code, meaning in MEANINGS.items()]
    return _joined(
        [
            "# Exit codes",
            "Every command ends with one of these codes. What went wrong is one line on stderr.",
            "\n".join(markdown_table(("code", "meaning"), rows)),
        ]
    )


def _meaning(quantity: Quantity) -> str:
    counted = "" if quantity.scale is None else f"; the key holds the count, shown over `{quantity.weight}`"
    return quantity.label + counted


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _joined(sections: object) -> str:
    title, *rest = sections  # type: ignore[misc]
    return "\n\n".join([title, GENERATED, *rest]) + "\n"


PAGES: dict[str, Callable[[], str]] = {
    "commands.md": commands_page,
    "settings.md": settings_page,
    "tables.md": tables_page,
    "metrics.md": metrics_page,
    "exit-codes.md": exit_codes_page,
    "evidence.md": evidence_page,
}

if __name__ == "__main__":
    for name, page in PAGES.items():
        (PLACE / name).write_text(page(), encoding="utf-8")
