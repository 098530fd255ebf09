"""Rows of pictures, written as numbered files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from matplotlib.figure import Figure

from harness.common.files import save_figure


def strips_in(folder: Path, kind: str) -> list[Path]:
    """Return the strips of a kind that a folder holds, in no order."""
    return list(folder.glob(f"{kind}-[0-9].png"))


def save_strips(figures: Iterable[Figure], folder: Path, kind: str) -> list[Path]:
    """Write ``KIND-1.png`` and so on in place of an earlier report's, and return them in order."""
    paths = []
    for number, figure in enumerate(figures, start=1):
        paths.append(folder / f"{kind}-{number}.png")
        save_figure(figure, paths[-1])
    for stale in set(strips_in(folder, kind)) - set(paths):
        stale.unlink()
    return paths
