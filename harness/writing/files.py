"""Files of results: numbers for programs, the same as tables for people, and settings as TOML."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w


def write_results(folder: Path, numbers: Mapping[str, Any], text: str) -> None:
    """Write ``results.json`` and ``results.md`` into a folder, which is made if missing."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    (folder / "results.md").write_text(text, encoding="utf-8")


def write_toml(path: Path, table: Mapping[str, Any], comment: str) -> None:
    """Write a table as TOML below a comment, whose lines are given without their ``#``."""
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    path.write_text(f"{head}\n{tomli_w.dumps(table)}", encoding="utf-8")
