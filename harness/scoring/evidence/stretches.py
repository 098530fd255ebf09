"""Unbroken runs of rows in which a condition holds, and those of a missed braking."""

import numpy as np

from harness.scoring.evidence.rules import DECISION_S, TIME_TOLERANCE_S
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray


def stretches(holds: BoolArray, group: IntArray) -> tuple[IntArray, IntArray]:
    """Return the first and the last row of each unbroken stretch in which something holds of an episode or vehicle."""
    goes_on = holds[1:] & holds[:-1] & (np.diff(group) == 0)
    first = np.flatnonzero(holds & ~np.append(False, goes_on)[: len(holds)])
    return first, np.flatnonzero(holds & ~np.append(goes_on, False)[: len(holds)])


def lasting_stretches(holds: BoolArray, episode: IntArray, step_s: FloatArray) -> tuple[IntArray, IntArray]:
    """Return those that last ``DECISION_S`` or longer; the time that each step stands for is of shape (steps,)."""
    first, last = stretches(holds, episode)
    seconds = np.array([step_s[a : b + 1].sum() for a, b in zip(first, last, strict=True)])
    lasting = seconds >= DECISION_S - TIME_TOLERANCE_S if len(first) else np.zeros(0, dtype=bool)
    return first[lasting], last[lasting]


def missed_stretches(
    differ: BoolArray, withheld: BoolArray, episode: IntArray, step_s: FloatArray
) -> tuple[IntArray, IntArray]:
    """Return the first and the last step of each missed braking, in order.

    A missed braking is an unbroken stretch, ``DECISION_S`` or longer, of steps at which ``differ`` or ``withheld``
    holds, both of shape (steps,): the driver brakes by the truth and not by the tracks, or fails to brake as it ought
    to for a vehicle withheld in plain view. A track reported now and then would break such stretches. So if
    ``withheld`` holds for ``DECISION_S`` out of the last 2 ``DECISION_S``, the gaps in between count too.
    """
    holds = differ | withheld
    until_s = np.cumsum(step_s)
    missed_s = np.append(0.0, np.cumsum(np.where(withheld, step_s, 0.0)))
    for last in np.flatnonzero(withheld):
        window_s = until_s[last] - 2.0 * DECISION_S + TIME_TOLERANCE_S
        first = int(np.searchsorted(until_s, window_s, side="right"))
        first = max(first, int(np.searchsorted(episode, episode[last])))
        if missed_s[last + 1] - missed_s[first] >= DECISION_S - TIME_TOLERANCE_S:
            begun = first + int(np.argmax(withheld[first : last + 1]))
            holds[begun : last + 1] = True
    return lasting_stretches(holds, episode, step_s)
