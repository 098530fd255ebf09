"""Post-encroachment times (Allen, Shin and Cooper 1978) where the ego's path is crossed.

Such a time is that from when the first of two vehicles has left the place where their paths cross until the second one
comes to it.
"""

from dataclasses import dataclass

import numpy as np

from harness.decisions.bodies import Bodies, Egos
from harness.scoring.evidence.rows import RunRows
from mmpf.numerics.arrays import FloatArray, IntArray, wrapped

LEAST_ANGLE_RAD = np.deg2rad(20.0)
"""Paths that meet at a smaller angle go along each other, and have no crossing."""
NEAR_M = 6.0
# Steps of a vehicle farther than this apart are no piece of its path.
LONGEST_PIECE_M = 10.0


def post_encroachment_times(egos: Egos, bodies: Bodies, rows: RunRows) -> FloatArray:
    """Return the times of all encounters of the ego with true vehicles whose paths cross its own, shape (k,).

    The crossing's conflict area is as wide as the two vehicles; an encounter of which the record lacks an entry or an
    exit is left out, and one in which both are there at once has the time 0.
    """
    if not rows.has_headings:
        return np.zeros(0)
    found: list[float] = []
    for episode in np.unique(egos.episode):
        steps = np.flatnonzero((egos.episode == episode) & np.isfinite(egos.lon_m))
        own = TimedPath(egos.lon_m[steps], egos.lat_m[steps], rows.time_s[steps])
        size = float(egos.length_m[steps].max(initial=0.0)), float(egos.width_m[steps].max(initial=0.0))
        inside = np.flatnonzero(egos.episode[bodies.step] == episode)
        for vehicle in np.unique(rows.truth.vehicle[inside]).tolist():
            row = inside[rows.truth.vehicle[inside] == vehicle]
            if not own.comes_near(bodies.lon_m[row], bodies.lat_m[row]):
                continue
            other = TimedPath(bodies.lon_m[row], bodies.lat_m[row], rows.time_s[bodies.step[row]])
            met = encounter(own, size, other, (float(bodies.length_m[row[0]]), float(bodies.width_m[row[0]])))
            if met is not None:
                found.append(met.time_s)
    return np.array(found)


@dataclass(frozen=True)
class Encounter:
    """The post-encroachment time of two vehicles, and whether the first path's one came to the crossing first."""

    time_s: float
    own_first: bool


class TimedPath:
    """A vehicle's path: places in order of time, repeated ones left out."""

    def __init__(self, x: FloatArray, y: FloatArray, time_s: FloatArray) -> None:
        self.x, self.y, self.time_s = x, y, time_s
        self.step_x, self.step_y = np.diff(x), np.diff(y)
        self.along_m = np.concatenate([[0.0], np.cumsum(np.hypot(self.step_x, self.step_y))])

    def comes_near(self, x: FloatArray, y: FloatArray) -> bool:
        """Return whether places come near the box around the path."""
        if not len(self.x) or not len(x):
            return False
        near = [(own.min() - NEAR_M <= at) & (at <= own.max() + NEAR_M) for own, at in ((self.x, x), (self.y, y))]
        return bool((near[0] & near[1]).any())

    def time_at(self, along_m: float) -> float | None:
        """Return when an arc length is first reached; None beyond the record."""
        if not 0.0 <= along_m <= self.along_m[-1]:
            return None
        after = int(np.searchsorted(self.along_m, along_m))
        if after == 0:
            return float(self.time_s[0])
        before = after - 1
        share = (along_m - self.along_m[before]) / (self.along_m[after] - self.along_m[before])
        return float(self.time_s[before] + share * (self.time_s[after] - self.time_s[before]))


def encounter(
    own: TimedPath, size: tuple[float, float], other: TimedPath, others: tuple[float, float]
) -> Encounter | None:
    """Return the encounter at the first crossing of two paths; None where they don't cross, or one never gets there.

    Sizes are length and width of either path's vehicle.
    """
    crossing = _first_crossing(own, other)
    if crossing is None:
        return None
    along, across, angle = crossing
    spans = []
    for path, at, (length, width), (_, foreign) in ((own, along, size, others), (other, across, others, size)):
        reach = 0.5 * (length + (foreign + width * abs(np.cos(angle))) / np.sin(angle))
        spans.append((path.time_at(at - reach), path.time_at(at + reach)))
    first, second = sorted(spans, key=lambda span: np.inf if span[0] is None else span[0])
    if first[1] is None or second[0] is None:
        return None
    return Encounter(max(second[0] - first[1], 0.0), own_first=first is spans[0])


def _first_crossing(own: TimedPath, other: TimedPath) -> tuple[float, float, float] | None:
    """Return arc lengths of both at their paths' first crossing and its angle; None without one."""
    if len(own.x) < 2 or len(other.x) < 2:
        return None
    # Standing and what jumps makes no piece of a path.
    mine, theirs = _pieces(own), _pieces(other)
    ax, ay = own.step_x[mine][:, None], own.step_y[mine][:, None]
    bx, by = other.step_x[theirs], other.step_y[theirs]
    dx, dy = other.x[theirs] - own.x[mine][:, None], other.y[theirs] - own.y[mine][:, None]
    area = ax * by - ay * bx
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = (dx * by - dy * bx) / area, (dx * ay - dy * ax) / area
        meets = (s >= 0.0) & (s < 1.0) & (t >= 0.0) & (t < 1.0)
    angle = np.abs(wrapped(np.arctan2(by, bx) - np.arctan2(ay, ax)))
    meets &= (angle > LEAST_ANGLE_RAD) & (angle < np.pi - LEAST_ANGLE_RAD)
    if not meets.any():
        return None
    i, j = (int(index[0]) for index in np.nonzero(meets))
    along = own.along_m[mine[i]] + s[i, j] * np.hypot(ax[i, 0], ay[i, 0])
    across = other.along_m[theirs[j]] + t[i, j] * np.hypot(bx[j], by[j])
    return float(along), float(across), float(angle[i, j])


def _pieces(path: TimedPath) -> IntArray:
    length = np.diff(path.along_m)
    return np.flatnonzero((length > 1e-6) & (length < LONGEST_PIECE_M))
