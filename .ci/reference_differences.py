"""Where two makings of a reference table differ."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from harness.common.errors import InputError

TIMES = ("timing.", "total_s", "wall_times_s", "ms_p50", "ms_p95")
LATER = (", decisions.", ", conflicts.")
"""Columns of metrics that came after most references were made."""
TABLE, NUMBERS = "runs.parquet", "results.json"
KEYS = ("net", "density", "demand", "mismatch", "variant", "model", "update", "seed", "episode.kind")
"""Columns that say which run a row is of."""
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
    names = [name for name in (TABLE, NUMBERS) if (committed / name).is_file()]
    if not names:
        raise InputError(f"`name`: {committed} has no table to check; make the reference first")
    return [
        Difference(f"{name}, {place}", *values)
        for name in names
        for place, values in _differing(_read(committed / name), _read(remade / name))
        if not world_only or place.partition(", ")[2].startswith(WORLD)
    ]


def row_differences(committed: Path, remade: Path) -> tuple[list[Difference], int]:
    """Return every value in which runs made again differ from the committed ones, and how many runs were made again.

    Args:
        committed: Folder of the whole reference.
        remade: Folder with some of its runs.

    Raises:
        InputError: A run is not one of the committed ones, or there is none.
    """
    found, runs = list[Difference](), 0
    for path in sorted(remade.rglob(TABLE)):
        name = path.relative_to(remade)
        whole, part = (_rows(folder / name) for folder in (committed, remade))
        runs += len(part)
        for key, row in part.items():
            if key not in whole:
                raise InputError(f"`confirm`: {name} has no run {key}; make the whole table again")
            found += [Difference(f"{name}, {key}, {place}", *values) for place, values in _differing(whole[key], row)]
    if not runs:
        raise InputError(f"`confirm`: {remade} has no run; make the whole table again")
    return found, runs


def _rows(path: Path) -> dict[str, dict[str, Any]]:
    """Return the rows of a table by what they are runs of."""
    rows = pd.read_parquet(path)
    keys = rows[[key for key in KEYS if key in rows]].astype(object).fillna("-").map(str).agg(" ".join, axis=1)
    if not keys.is_unique:
        raise InputError(f"`confirm`: {path} has two rows of one run; make the whole table again")
    return dict(zip(keys, rows.to_dict("records"), strict=True))


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
