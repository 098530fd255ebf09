"""Finds recordings of real roads: they are not part of the project, so the user gives their folder."""

from __future__ import annotations

import os
from pathlib import Path

from harness.common.errors import InputError

VARIABLE = "MMPF_REALDATA"
PARAMETER = "real_data"
PAIRS = "car_following_pairs.parquet"
SNIPPETS = ("commonroad/*.xml", "ngsim/*.csv")


def real_data_folder(given: Path | None = None) -> Path:
    """Return the folder of real recordings.

    Args:
        given: What the user said; None for the environment variable ``MMPF_REALDATA``.

    Raises:
        InputError: Neither is given, or there is no such folder.
    """
    folder = given or os.environ.get(VARIABLE)
    if not folder or not Path(folder).is_dir():
        wrong = f"no real recordings in {folder}" if folder else "no folder of real recordings is given"
        raise InputError(f"`{PARAMETER}`: {wrong}; name it with `{PARAMETER}` or the variable {VARIABLE}")
    return Path(folder)


def pairs_file(folder: Path) -> Path:
    """Return the file of leader-follower pairs.

    Raises:
        InputError: It is not there.
    """
    path = folder / PAIRS
    if not path.is_file():
        raise InputError(f"`{PARAMETER}`: {folder} has no {PAIRS}; name another folder")
    return path


def snippet_files(folder: Path) -> list[Path]:
    """Return the files of recorded traffic, sorted by name within each layout.

    Raises:
        InputError: There is none.
    """
    found = [path for pattern in SNIPPETS for path in sorted(folder.glob(pattern))]
    if not found:
        raise InputError(
            f"`{PARAMETER}`: {folder} has no recorded traffic ({', '.join(SNIPPETS)}); name another folder"
        )
    return found
