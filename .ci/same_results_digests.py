"""What is compared of a command's results: a digest of each table's column, number, script, picture and file."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

# Wall times, the processor they were measured on, and what tells when and from which sources a folder was made.
NOT_COMPARED = (
    *("timing", "total_s", "tracker_ms", "truth_ms", "sensor_ms", "realtime_factor", "_ms.", "wall_times_s"),
    *("code_sha256", "files_sha256"),  # of the code itself, and of files with wall times
    *("git_revision", "versions", "machine", "created", "finished_at", "started_at"),
)
# In texts and pages the same, by the words around it.
MASKS = tuple(
    (re.compile(pattern), replacement)
    for pattern, replacement in (
        (r"A tracker step took .*? real time\.", "(time of a step)"),
        (r"\b\d[\d.]* ?ms\b", "(ms)"),
        (r"open [\d.]+ s, loop [\d.]+ s[^<\n]*", "(wall times)"),
        (r"\b[0-9a-f]{40}(-dirty)?\b", "(revision)"),
        (r"\b(code|files)_sha256\b[^}]*\}", "(digests)"),
    )
)
# Columns of wall times in the tables of texts and pages, and charts of them.
TIMED_HEADING = re.compile(r"\bms\b|timing|total_s|realtime_factor|_ms\b")
TIMED_CHART = "time of a step"
# A grid's curves, in one picture, have a panel of the time of a step.
TIMED_PICTURES = re.compile(r"^over_[^/]*\.png$")


def masked(text: str, paths: tuple[str, ...]) -> str:
    """Return a text without wall times, revisions and the folders of this comparison."""
    for path in paths:
        text = text.replace(path, "(folder)")
    for pattern, replacement in MASKS:
        text = pattern.sub(replacement, text)
    return text


def of_text(text: str) -> str:
    """Return a text's digest."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def of_folder(folder: Path, paths: tuple[str, ...]) -> dict[str, str]:
    """Return the digests of the parts of all files of a folder; none of a folder that is not there."""
    parts: dict[str, str] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            where = path.relative_to(folder).as_posix()
            parts |= {f"{where}{part}": digest for part, digest in _parts(path, paths)}
    return parts


def _parts(path: Path, paths: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    content = path.read_bytes()
    if path.suffix == ".gz":
        # The header of a packed file may hold the time at which it was packed.
        content = gzip.decompress(content)
    if TIMED_PICTURES.match(path.name):
        return
    match path.suffix:
        case ".parquet":
            table = pd.read_parquet(path)
            yield " columns", of_text(" ".join(map(str, table.columns)))
            for column in table:
                if not _left_out(str(column)):
                    yield f":{column}", of_text(f"{table[column].dtype} {table[column].to_csv(index=False)}")
        case ".json":
            yield from _leaves(json.loads(content), paths)
        case ".npz":
            for name, array in np.load(io.BytesIO(content), allow_pickle=False).items():
                yield f":{name}", hashlib.sha256(f"{array.dtype} {array.shape}".encode() + array.tobytes()).hexdigest()
        case ".html":
            yield from _parts_of_page(content.decode(), paths)
        case ".md":
            yield "", of_text(masked(_untimed_markdown(content.decode()), paths))
        case _:
            try:
                yield "", of_text(masked(content.decode(), paths))
            except UnicodeDecodeError:
                yield "", hashlib.sha256(content).hexdigest()[:16]


def _parts_of_page(page: str, paths: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """Yield a digest for each script's data by its keys, each script, and the page around them."""
    script = re.compile(r"<script([^>]*)>(.*?)</script>", re.DOTALL)
    for place, (attributes, content) in enumerate(script.findall(page)):
        name = re.search(r'id="([^"]*)"', attributes)
        label = f" script {name[1] if name else place}"
        if "application/json" in attributes:
            data = json.loads(content)
            entries = data.items() if isinstance(data, dict) else enumerate(data)
            for key, value in entries:
                if TIMED_CHART in json.dumps(value) and "$schema" in value:
                    continue
                yield f"{label}.{key}", of_text(masked(json.dumps(value), paths))
        else:
            yield label, of_text(content)
    text = re.sub(r"<table.*?</table>", _untimed_table, script.sub("<script>", page), flags=re.DOTALL)
    yield " text", of_text(masked(text, paths))


def _untimed_table(table: re.Match[str]) -> str:
    """Return a page's table without columns of wall times, which its first row names."""
    rows = [re.findall(r"<t[hd].*?</t[hd]>", row, re.DOTALL) for row in re.findall(r"<tr.*?</tr>", table[0], re.DOTALL)]
    timed = {place for place, cell in enumerate(rows[0] if rows else []) if TIMED_HEADING.search(cell)}
    if not timed:
        return table[0]
    return repr([[cell for place, cell in enumerate(row) if place not in timed] for row in rows])


def _untimed_markdown(text: str) -> str:
    """Return a text whose tables are without columns of wall times."""
    lines, timed, inside = [], set[int](), False
    for line in text.splitlines():
        cells = line.split(" | ") if line.startswith("|") else []
        if cells and not inside:
            timed = {place for place, cell in enumerate(cells) if TIMED_HEADING.search(cell)}
        inside = bool(cells)
        lines.append(" | ".join(cell for place, cell in enumerate(cells) if place not in timed) if cells else line)
    return "\n".join(lines)


def _leaves(value: object, paths: tuple[str, ...], key: str = "") -> Iterator[tuple[str, str]]:
    if _left_out(key):
        return
    if isinstance(value, dict):
        if any(str(item).startswith("timing") for item in value.values()):
            return  # a curve of wall times
        for name, item in value.items():
            yield from _leaves(item, paths, f"{key}.{name}")
    elif isinstance(value, list):
        for place, item in enumerate(value):
            yield from _leaves(item, paths, f"{key}[{place}]")
    else:
        yield f":{key}", masked(repr(value), paths)


def _left_out(key: str) -> bool:
    return any(word in key for word in NOT_COMPARED)
