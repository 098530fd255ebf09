"""Ways to spoil texts, bytes and tables, each decided by a generator of random numbers."""

import gzip
import os
import random
import re
from collections.abc import Callable
from pathlib import Path

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


OTHERWISE = "HARNESS_FUZZ_OTHERWISE"
"""Where it is set, every content is changed in one of ``OTHER_WAYS``."""
DONE: list[str] = []
"""What was changed since this list was last emptied, in words, for whoever judges what was accepted."""


def spoilt_bytes(content: bytes, rng: random.Random) -> bytes:
    """Return a content with one to three things about it changed."""
    if os.environ.get(OTHERWISE) or rng.random() < 0.3:
        way = rng.choice(sorted(OTHER_WAYS))
        DONE.append(way)
        return OTHER_WAYS[way](content, rng)
    # Mostly what still has the form of its format, so that more than the parser is tried.
    if rng.random() < 0.7:
        for _ in range(rng.randint(1, 2)):
            content = _other_number(content, rng)
        return content
    way = rng.choice((_cut, _flipped, _without_line, _twice))
    DONE.append(way.__name__)
    return way(content, rng)


def _scaled(content: bytes, rng: random.Random) -> bytes:
    """Multiply every number that stands after one word, or in one column, by a wrong unit or sign."""
    factor = rng.choice((3.28084, 0.3048, 1e3, 1e-3, -1.0, 57.29578, 1e6))
    words = sorted(set(re.findall(rb"[A-Za-z_]{1,20}(?==\"-?\d)", content))) or [b""]
    word, column = rng.choice(words), rng.randrange(8)
    DONE.append(f"{word!r} or column {column} times {factor:g}")

    def times(found: re.Match[bytes]) -> bytes:
        return found[1] + repr(float(found[2]) * factor).encode()

    if word:
        return re.sub(rb"(\b" + word + rb"=\")(-?\d+\.?\d*)", times, content)
    return re.sub(rb"(?m)(^(?:[^,\n]*,){%d})(-?\d+\.?\d*)" % column, times, content)


def _names_exchanged(content: bytes, rng: random.Random) -> bytes:
    """Let one name stand for another everywhere."""
    names = sorted(set(re.findall(rb"\"([A-Za-z_:][\w:]{0,30})\"", content)) or {b"a", b"b"})
    one, other = rng.choice(names), rng.choice(names)
    DONE.append(f"{one!r} is {other!r}")
    return content.replace(b'"' + one + b'"', b'"' + other + b'"')


def _with_element(content: bytes, rng: random.Random) -> bytes:
    """Put in an element that writes, reads, waits or repeats itself."""
    file = rng.choice(("victim", "../victim", str(Path.cwd() / "victim"), "/dev/full", "/etc/passwd"))
    edge, period = rng.choice(("upstream", "approach")), rng.choice(("1", "0", "1e-9", "exp(1e9)"))
    element = rng.choice(
        (
            f'<inductionLoop id="x" lane="{edge}_1" pos="1" period="{period}" file="{file}"/>',
            f'<laneData id="x" period="{period}" file="{file}"/><vTypeProbe id="y" period="1" file="{file}"/>',
            f'<calibrator id="x" edge="{edge}" pos="1" output="{file}" freq="1"/>',
            f'<variableSpeedSign id="x" lanes="{edge}_1" file="{file}"/>',
            f'<routeProbe id="r" edge="{edge}" file="{file}"/>',
            f'<rerouter id="x" edges="{edge}" file="{file}"/><tlLogic id="x" type="static" programID="{file}"/>',
            f'<timedEvent type="SaveTLSStates" source="x" dest="{file}"/><include href="{file}"/>',
            f'<param key="has.ssm.device" value="true"/><param key="device.fcd.file" value="{file}"/>',
            f'<flow id="z" from="{edge}" to="{edge}" begin="0" period="{period}"/>' * 3,
            f'<parkingArea id="x" lane="{edge}_0" roadsideCapacity="{rng.choice((9, 10**9))}"/>',
        )
    ).encode()
    DONE.append(repr(element[:120]))
    ends = [found.start() for found in re.finditer(rb"</|/>", content)]
    after = content.find(b">", rng.choice(ends)) + 1 if ends else 0
    return content[:after] + element + content[after:]


def _twice_as_one(content: bytes, rng: random.Random) -> bytes:
    """Repeat a line or element many times."""
    pieces = re.findall(rb"<[^<>]*/>|[^\n]+\n", content[:1_000_000]) or [content]
    piece = rng.choice(pieces)
    times = rng.choice((2, 1000, 50_000))
    DONE.append(f"{piece[:60]!r} {times} times")
    return content.replace(piece, piece * times, 1)


OTHER_WAYS: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "scaled": _scaled,
    "names exchanged": _names_exchanged,
    "element put in": _with_element,
    "many times": _twice_as_one,
    "UTF-16": lambda content, _: content.decode("utf-8", "replace").encode("utf-16"),
    "byte order mark": lambda content, _: b"\xef\xbb\xbf" + content,
    "carriage returns": lambda content, _: content.replace(b"\n", b"\r"),
    "packed twice": lambda content, _: gzip.compress(gzip.compress(content)),
    "packed, with rubbish behind it": lambda content, _: gzip.compress(content) + b"rubbish",
    "upside down": lambda content, _: b"\n".join(reversed(content.split(b"\n"))),
    "with itself": lambda content, _: content + content,
    "deep": lambda content, _: content[:200] + b"<a>" * 100_000 + b"[" * 100_000 + content[200:],
    "one long token": lambda content, _: content.replace(b" ", b" " * 10_000_000, 1),
    "comma for point": lambda content, _: re.sub(rb"(\d)\.(\d)", rb"\1,\2", content),
}
"""Ways that keep most of a content and its form, and change what it means."""


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
        "scaled": lambda: table.assign(**{name: table[name] * 3.28}) if table[name].dtype.kind in "if" else table,
        "exchanged": lambda: table.rename(columns=dict(zip(table, [*table][1:] + [*table][:1], strict=True))),
        "backwards": lambda: table.iloc[::-1],
        "as texts": lambda: table.assign(**{name: table[name].astype(str)}),
        "many times": lambda: pd.concat([table] * 300),
        "a row many times": lambda: table.loc[table.index.repeat(np.where(table.index == table.index[-1], 10**6, 1))],
        "lists": lambda: table.assign(**{name: [[1]] * len(table)}),
    }
    way = rng.choice(sorted(changes))
    changed = changes[way]()
    shown = changed[name].iloc[:1].tolist() if name in changed else []
    DONE.append(f"{way}: {name} {shown}")
    return changed
