"""A road as a file of its own, so that a run can be replayed and drawn without its network."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from harness.errors import InputError
from mmpf.road import Lane, Road


def write_road(road: Road, path: Path) -> None:
    """Write a road so that a replay needs no network."""
    path.write_text(json.dumps(asdict(road), indent=1) + "\n", encoding="utf-8")


def read_road(path: Path, parameter: str) -> Road:
    """Return the road that a file holds.

    Args:
        path: The file.
        parameter: Parameter that named it, for the message.

    Raises:
        InputError: The file is missing or broken.
    """
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
        return Road(
            lanes=tuple(Lane(**lane) for lane in fields["lanes"]),
            reference_xy=tuple((float(x), float(y)) for x, y in fields["reference_xy"]),
            reference_start_m=float(fields["reference_start_m"]),
            section_m=(float(fields["section_m"][0]), float(fields["section_m"][1])),
        )
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise InputError(f"`{parameter}`: {path} is missing or broken ({error})") from None
