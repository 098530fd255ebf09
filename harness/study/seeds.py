"""Seed ranges as the command line gives them."""

from __future__ import annotations

from harness.errors import UserError


def seed_range(text: str, option: str = "--seeds") -> tuple[int, int]:
    """Return first seed and count of a range ``A:B``, B excluded.

    Raises:
        UserError: The text is no such range.
    """
    first, colon, end = text.partition(":")
    if not (colon and first.isdecimal() and end.isdecimal() and int(first) < int(end)):
        raise UserError(f"{option} {text}: give a range A:B with A below B, for example 0:16")
    return int(first), int(end) - int(first)
