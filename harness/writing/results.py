"""A study's results: numbers for programs, and the same as tables for people."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def write_results(folder: Path, numbers: Mapping[str, Any], text: str) -> None:
    """Write ``results.json`` and ``results.md`` into a folder, which is made if missing."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    (folder / "results.md").write_text(text, encoding="utf-8")
