"""Resamples each vehicle's trajectory to the common clock of 0.1 s."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from harness.common.errors import InputError
from harness.truth.frame import STEP_S
from harness.truth.recorded.order import MOST_ROWS, Stays
from harness.truth.recorded.rows import Rows
from mmpf.numerics.arrays import FloatArray, IntArray, wrapped

# How far a recorded time may be off the clock and still be taken as on it.
ON_CLOCK = 1e-3
LINEAR = ("heading_rad", "speed_mps", "lat_speed_mps", "length_m", "width_m")


@dataclass(frozen=True)
class Clocked:
    """Rows on the clock.

    Attributes:
        rows: The rows, sorted by stay and time; ``time_s`` is on the clock, from 0.
        step: Tick of each row, shape (n,).
        stay: Stay of each row, an index into ``Stays``, shape (n,).
        filled: How many rows lie in pauses longer than the usual interval.
        in_plane: Whether the road frame is the plane.
    """

    rows: Rows
    step: IntArray
    stay: IntArray
    filled: int
    in_plane: bool = False


def on_clock(stays: Stays) -> Clocked:
    """Interpolate each stay at the ticks of the clock, which starts with the recording.

    Rows on a tick go through unchanged. Between rows positions follow the cubic that has the recorded speeds at both
    ends where the rows are more than a tick apart (Hermite), else a straight line; everything else is linear.
    """
    rows = stays.rows
    ticks = (rows.time_s - rows.time_s.min()) / STEP_S
    near = np.round(ticks)
    ticks = np.where(np.abs(ticks - near) <= ON_CLOCK, near, ticks)
    first = np.ceil(ticks[stays.starts]).astype(np.int64)
    count = np.maximum(np.floor(ticks[stays.ends - 1]).astype(np.int64) - first + 1, 0)
    if count.sum() > MOST_ROWS:
        raise InputError(f"the recording has {count.sum()} vehicle-times; at most {MOST_ROWS} are driven, so cut it")
    stay = np.repeat(np.arange(len(stays.starts)), count)
    step = first[stay] + np.arange(len(stay)) - np.repeat(np.cumsum(count) - count, count)
    before = _row_at_or_before(ticks, stays, stay, step)
    after = np.minimum(before + 1, stays.ends[stay] - 1)
    apart = np.maximum(ticks[after] - ticks[before], 1e-12)
    share = np.where(after > before, np.clip((step - ticks[before]) / apart, 0.0, 1.0), 0.0)
    inside = (share > 0.0) & (share < 1.0)
    return Clocked(
        rows=_interpolated(rows, _Between(before, after, share, apart * STEP_S), stay, step, stays.in_plane),
        step=step,
        stay=stay,
        filled=int((inside & (apart * STEP_S > 1.5 * stays.interval_s)).sum()),
        in_plane=stays.in_plane,
    )


def _row_at_or_before(ticks: FloatArray, stays: Stays, stay: IntArray, step: IntArray) -> IntArray:
    span = float(ticks.max()) + 2.0
    key = stays.rows.vehicle * span + ticks
    return np.asarray(np.searchsorted(key, stay * span + step + 1e-6, side="right") - 1, dtype=np.int64)


class _Between(NamedTuple):
    """Where on its way from one row to the next each tick lies; arrays of shape (n,)."""

    before: IntArray
    after: IntArray
    share: FloatArray
    apart_s: FloatArray

    def linear(self, values: FloatArray) -> FloatArray:
        """Return values on the straight line between the two rows."""
        before, after = values[self.before], values[self.after]
        # A value times 0 is nan where it is unknown, so rows on a tick are copied.
        mixed = before + self.share * (after - before)
        return np.where(self.share == 0.0, before, np.where(self.share == 1.0, after, mixed))

    def position(self, values: FloatArray, speed: FloatArray) -> FloatArray:
        """Return positions on the cubic that has the speeds of both rows, where they are more than a tick apart."""
        share, straight = self.share, self.linear(values)
        chord = values[self.after] - values[self.before]
        start, end = speed[self.before] * self.apart_s - chord, chord - speed[self.after] * self.apart_s
        bulge = share * (1.0 - share) * ((1.0 - share) * start + share * end)
        curved = (self.apart_s > STEP_S + 1e-6) & (share > 0.0) & (share < 1.0) & np.isfinite(bulge)
        return np.where(curved, straight + bulge, straight)

    def angle(self, values: FloatArray) -> FloatArray:
        """Return angles on the shorter way round between the two rows."""
        turned = self.share * wrapped(values[self.after] - values[self.before])
        return wrapped(np.where(self.share == 1.0, values[self.after], values[self.before] + turned))


def _interpolated(rows: Rows, between: _Between, stay: IntArray, step: IntArray, in_plane: bool) -> Rows:
    linear = {name: between.linear(getattr(rows, name)) for name in LINEAR}
    lon_speed, lat_speed = rows.speed_mps, rows.lat_speed_mps
    if in_plane:
        linear["heading_rad"] = between.angle(rows.heading_rad)
        cosine, sine, aside = np.cos(rows.heading_rad), np.sin(rows.heading_rad), np.nan_to_num(lat_speed)
        lon_speed, lat_speed = lon_speed * cosine - aside * sine, lon_speed * sine + aside * cosine
    return Rows(
        vehicle=stay,
        time_s=np.asarray(step * STEP_S, dtype=np.float64),
        lon_m=between.position(rows.lon_m, lon_speed),
        lat_m=between.position(rows.lat_m, lat_speed),
        **linear,
    )
