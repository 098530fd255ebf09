"""The list of reference tables, ``results/reference/tables.toml``: what each is for and the command that makes it."""

from __future__ import annotations

import difflib
import shlex
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.common.errors import InputError

FOLDER = Path("results") / "reference"
TABLES = FOLDER / "tables.toml"
KEYS = {"about", "command", "files"}


@dataclass(frozen=True)
class Reference:
    """One reference table, or a folder of them.

    Attributes:
        name: Its name, and that of its folder.
        about: What it is for.
        words: The command that makes it, as words.
        files: Names of what is kept of it; empty keeps all tables, numbers and pictures.
    """

    name: str
    about: str
    words: tuple[str, ...]
    files: tuple[str, ...] = ()

    @property
    def command(self) -> str:
        """The command as it is typed."""
        return shlex.join(["python", "-m", "harness", *self.words])


def references(root: Path) -> dict[str, Reference]:
    """Return all references by name.

    Args:
        root: Top folder of the source tree.

    Raises:
        InputError: The list is missing or broken.
    """
    path = root / TABLES
    try:
        listed = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {error}; restore it from the repository") from None
    return {name: _reference(name, entry, path) for name, entry in listed.items()}


def reference_named(name: str, root: Path) -> Reference:
    """Return a reference.

    Raises:
        InputError: There is none of that name.
    """
    known = references(root)
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
        meant = f"do you mean {near[0]}?" if near else f"choose one of {', '.join(known)}"
        raise InputError(f"`name` {name}: no such reference; {meant}")
    return known[name]


def _reference(name: str, entry: object, path: Path) -> Reference:
    if not isinstance(entry, Mapping) or not entry.keys() <= KEYS or not {"about", "command"} <= entry.keys():
        raise InputError(f"{path}: [{name}] needs about and command, and may have files; nothing else")
    words = tuple(shlex.split(str(entry["command"])))
    if not words or any(word in ("--out", "--resume", "--quiet") for word in words):
        raise InputError(f"{path}: [{name}]: give a command without --out, --resume and --quiet; they are added")
    return Reference(name, str(entry["about"]), words, tuple(map(str, entry.get("files", ()))))
