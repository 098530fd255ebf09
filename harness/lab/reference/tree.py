"""The source tree that references are made from: its top, whether it is clean, and what its results depend on."""

from __future__ import annotations

import hashlib
import subprocess
from pathlib import Path

from harness.common.errors import InputError
from harness.lab.reference.catalogue import FOLDER

SOURCES = ("mmpf", "harness", "networks", "constraints.txt")
"""What results depend on; pages, tests and the list of references may change between the runs of a table."""


def top_of_tree() -> Path:
    """Return the top folder of the source tree that this program runs from.

    Raises:
        InputError: It is an installed package, or git is missing.
    """
    # An installed package may lie inside somebody else's repository.
    here = Path(__file__).parents[2]
    if _git(here, "ls-files", "--error-unmatch", "__init__.py") is None:
        raise InputError("reference: references are made from a clone of the repository, with git; this is none")
    return Path((_git(here, "rev-parse", "--show-toplevel") or "").strip())


def changes(root: Path) -> list[str]:
    """Return what differs from the revision, untracked files too, apart from the references themselves."""
    lines = (_git(root, "status", "--porcelain", "--untracked-files=all") or "").splitlines()
    paths = [line[3:].split(" -> ")[-1] for line in lines]
    return [path for path in paths if not path.startswith(f"{FOLDER.as_posix()}/")]


def revision(root: Path) -> str:
    """Return the revision."""
    return (_git(root, "rev-parse", "HEAD") or "").strip()


def sources_of(root: Path) -> str:
    """Return a digest of all that results depend on, as it is committed."""
    trees = [_git(root, "rev-parse", f"HEAD:{name}") or "" for name in SOURCES]
    return hashlib.sha256("".join(trees).encode()).hexdigest()[:16]


def tracked(root: Path, folder: Path) -> set[Path]:
    """Return the files below a folder that the repository holds."""
    names = (_git(root, "ls-files", "-z", "--", str(folder)) or "").split("\0")
    return {root / name for name in names if name}


def _git(folder: Path, *words: str) -> str | None:
    """Return what git answers in a folder; None if it can't."""
    command = ["git", "-C", str(folder), *words]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return answer.stdout if answer.returncode == 0 else None
