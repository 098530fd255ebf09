"""Which recorded vehicles carry the sensor, and when."""

import re
from dataclasses import dataclass

import numpy as np

from harness.common.errors import InputError
from harness.truth.frame import STEP_S
from harness.truth.recorded.traffic import RecordedTraffic
from mmpf.numerics.arrays import FloatArray, IntArray

AUTO, EACH = "auto", "each"
# each:12 is twelve of them, evenly spaced.
SOME_OF_EACH = re.compile(rf"{EACH}:([1-9]\d*)")
SHORTEST_EGO_S = 3.0


@dataclass(frozen=True)
class EgoStay:
    """A vehicle, by the index of its stay, that carries the sensor from one recorded step to another."""

    stay: int
    first_step: int
    last_step: int

    @property
    def steps(self) -> int:
        """Number of steps."""
        return self.last_step - self.first_step + 1


def plan_egos(traffic: RecordedTraffic, ego: str) -> tuple[EgoStay, ...]:
    """Return the egos in the order in which they are driven; each is an episode.

    Args:
        traffic: The traffic.
        ego: Name of a vehicle; ``auto``: at every time one that stays longest, and the next one when it is gone;
            ``each``: every vehicle that is in the window for 3 s or more, in turn; ``each:N``: at most N of those,
            evenly spaced in their order.

    Raises:
        InputError: There is no such vehicle, or none that stays long enough.
    """
    stays = _stays_in_window(traffic)
    if ego == EACH or SOME_OF_EACH.fullmatch(ego):
        shortest = round(SHORTEST_EGO_S / STEP_S)
        chosen = tuple(stay for stay in stays if stay.steps >= shortest)
        if not chosen:
            raise InputError(
                f"`ego` {EACH}: no vehicle is driven for {SHORTEST_EGO_S:g} s; take `ego` {AUTO} or a longer `duration`"
            )
        return _evenly_spaced(chosen, ego)
    if ego == AUTO:
        return _relay(traffic, stays)
    chosen = tuple(stay for stay in stays if str(traffic.names[stay.stay]) == ego)
    if not chosen:
        names = [str(traffic.names[stay.stay]) for stay in stays]
        known = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
        raise InputError(f"`ego` {ego}: no vehicle of that name is on record within the first seconds driven: {known}")
    return chosen


def _evenly_spaced(stays: tuple[EgoStay, ...], ego: str) -> tuple[EgoStay, ...]:
    """Return as many of the stays as ``ego`` says, the first and the last among them where it says two or more."""
    some = SOME_OF_EACH.fullmatch(ego)
    count = min(int(some[1]), len(stays)) if some else len(stays)
    return tuple(stays[round(place)] for place in np.linspace(0, len(stays) - 1, count))


def _stays_in_window(traffic: RecordedTraffic) -> list[EgoStay]:
    """Return when each stay is first and last in the window, in the order of the stays."""
    start_m, end_m = traffic.window_m
    lon_m = traffic.columns["lon_m"]
    inside = np.flatnonzero((lon_m >= start_m) & (lon_m <= end_m))
    stay, step = traffic.stay[inside], traffic.step_of_row[inside]
    order = np.lexsort((step, stay))
    stay, step = stay[order], step[order]
    first = np.flatnonzero(np.diff(stay, prepend=-1))
    last = np.append(first[1:], len(stay)) - 1
    return [EgoStay(int(stay[a]), int(step[a]), int(step[b])) for a, b in zip(first, last, strict=True)]


def _relay(traffic: RecordedTraffic, stays: list[EgoStay]) -> tuple[EgoStay, ...]:
    """Hand the sensor on whenever its vehicle is gone; of equally long stays that nearest the middle goes."""
    if not stays:
        raise InputError(f"`ego` {AUTO}: no vehicle is on record within the window")
    stay, first, last = np.array([(s.stay, s.first_step, s.last_step) for s in stays], dtype=np.int64).T
    off_middle_m = _distance_from_middle(traffic, stay)
    relay: list[EgoStay] = []
    now = int(first.min())
    while (left := np.flatnonzero(last >= now)).size:
        now = max(now, int(first[left].min()))
        present = left[first[left] <= now]
        best = present[np.lexsort((off_middle_m[present], -last[present]))[0]]
        relay.append(EgoStay(int(stay[best]), now, int(last[best])))
        now = int(last[best]) + 1
    return tuple(relay)


def _distance_from_middle(traffic: RecordedTraffic, stay: IntArray) -> FloatArray:
    """Return how far each stay's mean place is from the middle of what is on record, shape (s,)."""
    count = np.maximum(np.bincount(traffic.stay, minlength=len(traffic.names)), 1)

    def mean_m(column: str) -> FloatArray:
        return np.bincount(traffic.stay, weights=traffic.columns[column], minlength=len(traffic.names)) / count

    if traffic.knows_ends:
        return np.asarray(np.abs(mean_m("lon_m")[stay] - 0.5 * sum(traffic.window_m)))
    x, y = (mean_m(column)[stay] - float(traffic.columns[column].mean()) for column in ("lon_m", "lat_m"))
    return np.asarray(np.hypot(x, y))
