"""Whether what a tracker returned can be worked with at all."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from mmpf.tracks import Tracks


def fault_of(tracks: object) -> str | None:
    """Return what is wrong with what a step returned, in words, or None if it can be recorded and scored."""
    if not isinstance(tracks, Tracks):
        return f"step returned {type(tracks).__name__}, not Tracks"
    wanted = np.shape(tracks.track_id)
    for column in fields(Tracks):
        fault = _fault_of_column(getattr(tracks, column.name), wanted, is_place=column.name in {"lon_m", "lat_m"})
        if fault is not None:
            return f"{column.name} {fault}"
    return "two tracks have one identity" if len(np.unique(tracks.track_id)) < len(tracks) else None


def _fault_of_column(values: object, wanted: tuple[int, ...], *, is_place: bool) -> str | None:
    if not isinstance(values, np.ndarray):
        return f"is {type(values).__name__}, not an array"
    if values.shape != wanted or values.ndim != 1:
        return f"has shape {values.shape}, track_id {wanted}; both must be (m,)"
    if values.dtype.kind not in "fiu":
        return f"is {values.dtype}, not numbers"
    return "holds a value that is not finite" if is_place and not np.isfinite(values).all() else None
