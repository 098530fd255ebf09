"""The baselines' settings, tuned once by ``python -m harness.tuning`` on seeds 100-199 and kept as data."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

TUNED_FILE = Path(__file__).with_name("tuned.toml")


def tuned_options(tracker: str) -> dict[str, object]:
    """Return a tracker's tuned options; empty for one that was never tuned."""
    return dict(_tuned_tables().get(tracker, {}))


@cache
def _tuned_tables() -> dict[str, dict[str, object]]:
    if not TUNED_FILE.exists():
        return {}
    tables = tomllib.loads(TUNED_FILE.read_text(encoding="utf-8"))
    return {name: table["options"] for name, table in tables.items()}
