"""Where two makings of a reference table differ."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from harness.common.errors import InputError

TIMES = ("timing.", "total_s", "wall_times_s", "ms_p50", "ms_p95")
LATER = (", decisions.", ", conflicts.", "hidden_crps_m")
"""Columns of metrics that came after most references were made."""
TABLE, NUMBERS = "runs.parquet", "results.json"
SETTING = ("net", "density", "demand", "mismatch", "variant", "model", "update")
RUN = (*SETTING, "seed", "episode.kind")
"""Columns that say of which setting, and of which run of it, a row is."""
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


def row_differences(committed: Path, remade: Path) -> list[Difference]:
    """Return every value in which runs made again differ from the committed ones.

    Args:
        committed: Folder of the whole reference.
        remade: Folder with some of its runs.

    Raises:
        InputError: The committed one has no table of runs, or one that was not made again or has a run twice; a setting
            has no run among those made again; or one of these is not among the committed ones.
    """
    found, tables = list[Difference](), sorted(committed.rglob(TABLE))
    if not tables:
        raise InputError(f"`confirm`: {committed} has no {TABLE}; make the whole table again")
    for path in tables:
        name = path.relative_to(committed)
        if not (remade / name).is_file():
            raise InputError(f"`confirm`: {name} was not made again; make the whole table again")
        whole, part = (pd.read_parquet(folder / name) for folder in (committed, remade))
        if lacking := set(_names(whole, SETTING)) - set(_names(part, SETTING)):
            raise InputError(f"`confirm`: {name} has no run of {min(lacking)} made again; make the whole table again")
        rows = dict(zip(_names(whole, RUN), whole.to_dict("records"), strict=True))
        if len(rows) < len(whole):
            raise InputError(f"`confirm`: {path} has two rows of one run; make the whole table again")
        for run, row in zip(_names(part, RUN), part.to_dict("records"), strict=True):
            if run not in rows:
                raise InputError(f"`confirm`: {name} has no run {run}; make the whole table again")
            found += [Difference(f"{name}, {run}, {place}", *values) for place, values in _differing(rows[run], row)]
    return found


def _names(runs: pd.DataFrame, columns: Sequence[str]) -> pd.Series:
    """Return what the columns say of each run, as one text."""
    return runs[[name for name in columns if name in runs]].astype(object).fillna("-").map(str).agg(" ".join, axis=1)


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
