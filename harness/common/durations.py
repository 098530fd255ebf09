"""How long something will roughly take, in words and told beforehand."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable

# A guess deserves no second digit.
MINUTES = (1, 2, 3, 5, 7, 10, 15, 20, 30, 45, 60, 90, 120, 180, 240, 360, 480, 720, 1440, 2880, 4320, 7200, 14400)
LONG_S = 60.0


def rough_time(seconds: float) -> str:
    """Return a time in words, rounded up to a number that does not claim to be exact."""
    minutes = MINUTES[min(bisect_left(MINUTES, seconds / 60.0), len(MINUTES) - 1)]
    for unit, size in (("day", 1440), ("hour", 60)):
        if minutes >= 2 * size:
            return f"{minutes / size:g} {unit}s"
    return "a minute" if minutes == 1 else f"{minutes} minutes"


def say_roughly(say: Callable[[str], object], seconds: float, what: str) -> None:
    """Say how long something will take, if that is over a minute.

    Args:
        say: Told the line, once nothing can be wrong with the input any more.
        seconds: The guess, for a machine on which nothing else runs.
        what: What takes so long.
    """
    if seconds > LONG_S:
        say(f"{what}: roughly {rough_time(seconds)}, longer on a busy machine")
