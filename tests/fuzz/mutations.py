"""Ways to spoil texts, bytes and tables, each decided by a generator of random numbers."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

import numpy as np
import pandas as pd

NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
NUMBERS = (
    *(b"0", b"-1", b"nan", b"inf", b"-inf", b"1e308", b"-1e9", b"1e-300", b"2000000000", b"9999999999999999999999"),
    *(b"", b"x", b"0.0", b"NaN", b"0x10", b"1_0", b"1e400", b"\xc2\xb2", b"-0"),
)
WORDS = (
    *("nan", "-1", "0", "inf", "1e308", "x" * 300, "../../x", "/dev/null", "", " ", "\x01", "'", '"', "=1+1", "é" * 90),
    *("a:b", "os:system", "true", "[]", "{}", "--help", "-", "auto", "each", "each:0", "1e9", "99999999999999999999"),
)


DONE: list[str] = []
"""What was changed since this list was last emptied, in words, for whoever judges what was accepted."""


def spoilt_bytes(content: bytes, rng: random.Random) -> bytes:
    """Return a content with one to three things about it changed."""
    # Mostly what still has the form of its format, so that more than the parser is tried.
    if rng.random() < 0.7:
        for _ in range(rng.randint(1, 2)):
            content = _other_number(content, rng)
        return content
    way = rng.choice((_cut, _flipped, _without_line, _twice))
    DONE.append(way.__name__)
    return way(content, rng)


def _other_number(content: bytes, rng: random.Random) -> bytes:
    found = list(NUMBER.finditer(content[:2_000_000]))
    if not found:
        return content
    chosen = rng.choice(found)
    everywhere = rng.random() < 0.3
    new = rng.choice(NUMBERS)
    before, after = content[max(chosen.start() - 60, 0) : chosen.start()], content[chosen.end() : chosen.end() + 20]
    DONE.append(f"{before!r} [{chosen[0]!r} -> {new!r}] {after!r}{' everywhere' * everywhere}")
    # The same everywhere, as a wrong unit or a lost column would be.
    return (
        content.replace(chosen[0], new, 200)
        if everywhere
        else content[: chosen.start()] + new + content[chosen.end() :]
    )


def _cut(content: bytes, rng: random.Random) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def _flipped(content: bytes, rng: random.Random) -> bytes:
    spoilt = bytearray(content)
    for _ in range(min(len(spoilt), rng.choice((1, 5, 50)))):
        spoilt[rng.randrange(len(spoilt))] = rng.randrange(256)
    return bytes(spoilt)


def _without_line(content: bytes, rng: random.Random) -> bytes:
    lines = content.splitlines(keepends=True)
    if lines:
        del lines[rng.randrange(len(lines))]
    return b"".join(lines)


def _twice(content: bytes, rng: random.Random) -> bytes:
    start, end = sorted(rng.randrange(len(content) + 1) for _ in range(2))
    return content[:end] + content[start:end][:10_000] + content[end:]


def spoilt_table(table: pd.DataFrame, rng: random.Random) -> pd.DataFrame:
    """Return a table with values, rows or columns changed."""
    name = rng.choice(list(table.columns))
    changes: dict[str, Callable[[], pd.DataFrame]] = {
        "without": lambda: table.drop(columns=name),
        "cut": lambda: table.iloc[: rng.randrange(len(table) + 1)],
        "shuffled": lambda: table.sample(frac=1.0, random_state=rng.randrange(1000)),
        "rows twice": lambda: pd.concat([table, table.iloc[: rng.randrange(len(table) + 1)]]),
        "word": lambda: table.assign(**{name: rng.choice(WORDS)}),
        "number": lambda: table.assign(**{name: rng.choice([np.nan, np.inf, -1.0, 0.0, 1e308, 10**9, -(10**9)])}),
        "missing values": lambda: table.assign(
            **{name: table[name].where(np.arange(len(table)) != rng.randrange(len(table) + 1))}
        ),
        "renamed": lambda: table.rename(columns={name: rng.choice(WORDS)}),
        "lists": lambda: table.assign(**{name: [[1]] * len(table)}),
    }
    way = rng.choice(sorted(changes))
    changed = changes[way]()
    shown = changed[name].iloc[:1].tolist() if name in changed else []
    DONE.append(f"{way}: {name} {shown}")
    return changed
