"""Where two makings of one reference differ: every number and text of their tables, apart from how long things took."""

from __future__ import annotations

import hashlib
import json
import math
import platform
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from harness.common.errors import InputError
from harness.storage import run_folder as runfolder

TIMES = ("timing.", "total_s", "wall_times_s", "ms_p50", "ms_p95")
LATER = (", decisions.", ", conflicts.")
"""Columns of metrics that came after most references were made."""
TABLE, NUMBERS = "runs.parquet", ("results.json", "fidelity.json")
MOST_TOLD = 5
WORLD = (
    "net",
    "density",
    "seed",
    "succeeded",
    "traffic.",
    "detection_noise.",
    "occlusion.events",
    "mot.truth_n",
    "hidden.n",
)
"""Columns that traffic and detections alone decide, which are the same on every processor."""


@dataclass(frozen=True)
class Difference:
    """One value that differs.

    Attributes:
        place: Where it stands.
        committed: What is committed.
        remade: What it is now.
    """

    place: str
    committed: object
    remade: object

    def __str__(self) -> str:
        return f"{self.place}: committed {self.committed}, remade {self.remade}"


def differences(committed: Path, remade: Path, world_only: bool = False) -> list[Difference]:
    """Return every value that differs between two folders of one reference.

    Metrics of later making are no difference: the committed one knows nothing of them.

    Args:
        committed: Folder of the first.
        remade: Folder of the second.
        world_only: Whether only what traffic and detections decide is held together: on another kind of processor
            tracks and scores differ by what rounding grows to.

    Raises:
        InputError: The committed one has no table.
    """
    names = [name for name in (TABLE, *NUMBERS) if (committed / name).is_file()]
    if not names:
        raise InputError(f"`name`: {committed} has no table to check; make the reference first")
    return [
        Difference(f"{name}, {place}", *values)
        for name in names
        for place, values in _differing(_read(committed / name), _read(remade / name))
        if not world_only or place.partition(", ")[2].startswith(WORLD)
    ]


def told(found: list[Difference], committed: Path) -> str:
    """Return the differences in a paragraph, the first few of them, and on which machine the committed was made."""
    more = f"\n  and {len(found) - MOST_TOLD} more" if len(found) > MOST_TOLD else ""
    lines = "\n".join(f"  {each}" for each in found[:MOST_TOLD])
    made = _manifest(committed)
    on = f" (made on {made['machine'].get('processor')}, of {made.get('git_revision')})" if made else ""
    return f"{len(found)} values differ from {committed}{on}:\n{lines}{more}"


def made_here(folder: Path) -> bool:
    """Return whether a reference was made on a processor of this machine's kind."""
    made = _manifest(folder)
    return bool(made and made["machine"].get("kind") == processor_kind())


def _manifest(folder: Path) -> dict[str, Any] | None:
    """Return a folder's manifest; None where it is missing or tells no machine."""
    try:
        found = json.loads((folder / runfolder.MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and isinstance(found.get("machine"), dict) else None


def processor_kind() -> str:
    """Return a digest of what the processor can do, by which libraries choose their kernels."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    told = {line.partition(":")[0].strip(): line.partition(":")[2].strip() for line in reversed(lines)}
    able = " ".join(sorted((told.get("flags") or told.get("Features") or "").split()))
    return hashlib.sha256(f"{told.get('model name')} {platform.machine()} {able}".encode()).hexdigest()[:16]


def _read(path: Path) -> dict[str, Any]:
    """Return a table's values by their place."""
    if not path.is_file():
        return {}
    if path.suffix == ".json":
        return dict(_leaves(json.loads(path.read_text(encoding="utf-8")), ""))

    rows = pd.read_parquet(path)
    return {
        f"row {place}, {column}": value
        for column in map(str, rows)
        for place, value in enumerate(rows[column].tolist())
    }


def _leaves(value: object, place: str) -> Iterator[tuple[str, object]]:
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
    if inside is None:
        yield place, value
        return
    for key, item in inside:
        yield from _leaves(item, f"{place}.{key}" if place else str(key))


def _differing(first: dict[str, Any], second: dict[str, Any]) -> Iterator[tuple[str, tuple[object, object]]]:
    for place in dict.fromkeys((*first, *second)):
        if place not in first and any(word in place for word in LATER):
            continue
        pair = first.get(place), second.get(place)
        if not any(word in place for word in TIMES) and not _same(*pair):
            yield place, pair


def _same(a: object, b: object) -> bool:
    missing = [value is None or (isinstance(value, float) and math.isnan(value)) for value in (a, b)]
    return all(missing) or a == b
