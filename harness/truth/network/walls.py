"""Buildings and walls of a SUMO network: what stands beside the roads and hides what is behind it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.sax import SAXException

import numpy as np

from harness.common.errors import InputError
from mmpf.numerics.arrays import FloatArray

# Types of polygons, as netconvert and polyconvert write them, that stand up from the ground.
OPAQUE = ("building", "wall", "barrier.wall")
MOST_WALLS = 200_000


def read_walls(files: Iterable[Path]) -> FloatArray | None:
    """Return the outlines of the buildings in additional files as rows of x and y of either end, metres, (w, 4).

    Heights are not known and play no part: a building hides whatever is behind it.

    Args:
        files: SUMO's additional files; those without polygons add nothing.

    Returns:
        The walls; None if there are none.

    Raises:
        InputError: A file can't be read, or there are more walls than any network needs.
    """
    from sumolib.shapes import polygon  # noqa: PLC0415  (heavy)

    walls: list[FloatArray] = []
    for file in files:
        try:
            found = polygon.read(str(file))
        except (SAXException, ValueError, KeyError, AttributeError, TypeError, IndexError, OSError) as error:
            raise InputError(f"{file}: its polygons can't be read: {error}") from error
        opaque = [each.shape for each in found if str(each.type).startswith(OPAQUE) and len(each.shape) > 1]
        if not all(np.isfinite(shape).all() for shape in opaque):
            raise InputError(f"{file}: a polygon has a corner that is not finite")
        walls.extend(_outline(np.asarray(shape, dtype=np.float64)[:, :2]) for shape in opaque)
    if not walls:
        return None
    rows = np.concatenate(walls)
    if len(rows) > MOST_WALLS:
        raise InputError(f"the network's polygons have {len(rows)} walls; at most {MOST_WALLS} are taken")
    return rows


def _outline(corners: FloatArray) -> FloatArray:
    """Return the sides of a polygon, shape (k, 4), the one that closes it too; without those of no length."""
    sides = np.concatenate([corners, np.roll(corners, -1, axis=0)], axis=1)
    return np.asarray(sides[np.hypot(sides[:, 2] - sides[:, 0], sides[:, 3] - sides[:, 1]) > 1e-6])
