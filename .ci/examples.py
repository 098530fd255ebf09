"""Run the commands that README and tutorials show, and compare what they print with the output shown.

A page's blocks of ``sh`` run in order, in a folder of their own. ``<!-- command: NAME -->`` or
``<!-- not run: WHY -->`` before a block leaves it out. ``<!-- file: NAME -->`` before a block of any page puts it into
each folder under that name. A block without a language after one of ``sh`` is its output; ``...`` stands for lines that
are left out. Numbers differ between processors, so that only the words are compared; ``--write`` puts today's numbers
into the pages.

    python .ci/examples.py [--write] [PAGE ...]
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs" / "tutorials").glob("*.md")))
BLOCK = re.compile(
    r"(?:<!-- (?P<mark>[a-z ]+): (?P<word>[^>]*?) -->\n+)?```(?P<language>\w*)\n(?P<text>.*?)```", re.DOTALL
)
SECONDS = 900
VERDICTS = (0, 1, 4)  # no worse, worse, undecided


class Example(NamedTuple):
    """A block of commands and the output that the page shows; None where it shows none."""

    commands: str
    shown: str | None


def examples(page: str) -> Iterator[Example]:
    """Yield the examples of a page."""
    blocks = list(BLOCK.finditer(page))
    for block, following in zip_longest(blocks, blocks[1:]):
        if block["language"] == "sh" and block["mark"] is None:
            adjacent = following is not None and not page[block.end() : following.start()].strip()
            output = following["text"] if adjacent and following and not following["language"] else None
            yield Example(block["text"], output)


def files() -> dict[str, str]:
    """Return the files that pages ask their readers to save, by name."""
    texts = (page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md"))
    blocks = (block for text in texts for block in BLOCK.finditer(text))
    return {block["word"]: block["text"] for block in blocks if block["mark"] == "file"}


def run(commands: str, folder: Path) -> str:
    """Run commands and return what they print.

    Raises:
        RuntimeError: A command fails.
    """
    paths = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-e", "-c", commands],
        cwd=folder,
        env=os.environ | {"PATH": paths, "PYTHONPATH": str(ROOT), "COLUMNS": "80", "NO_COLOR": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    if done.returncode not in VERDICTS:
        raise RuntimeError(f"exit code {done.returncode}:\n{commands}\n{done.stdout}")
    return done.stdout


def matched(shown: str, printed: str) -> list[str]:
    """Return the lines of an output that a page shows, as they are printed today.

    Raises:
        ValueError: A line that the page shows is not printed, or not in this order.
    """
    rest = iter(printed.splitlines())
    lines = []
    for line in shown.splitlines():
        same = line if line == "..." else next((each for each in rest if _words(each) == _words(line)), None)
        if same is None:
            raise ValueError(f"this line is not printed:\n{line}\nWhat is printed:\n{printed}")
        lines.append(same.rstrip())
    return lines


def _words(line: str) -> str:
    """Return a line without its numbers and spaces."""
    return re.sub(r"\s+", " ", re.sub(r"[-+]?\d[\d.]*", "#", line)).strip()


def current(page: Path) -> str:
    """Run the examples of a page and return the page with today's output."""
    text = page.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as name:
        for file, content in files().items():
            (Path(name) / file).write_text(content, encoding="utf-8")
        for example in examples(text):
            printed = run(example.commands, Path(name))
            if example.shown is not None:
                text = text.replace(example.shown, "\n".join([*matched(example.shown, printed), ""]))
    return text


if __name__ == "__main__":
    words = sys.argv[1:]
    for page in [Path(word).resolve() for word in words if word != "--write"] or PAGES:
        new = current(page)
        if "--write" in words:
            page.write_text(new, encoding="utf-8")
        sys.stdout.write(f"{page.name}: its commands run and print what it shows\n")
