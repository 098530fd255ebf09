"""The figures by which a period of traffic is judged, and the tolerated differences from the measured ones.

The same code takes them from the fields of recorded and of simulated traffic.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from harness.lab.fidelity.fields import BIN_S, CELL_M, Fields
from mmpf.numerics.arrays import FloatArray

QUARTERS = 4
SLOW_MPS = 4.0
# Slower changes than this are no waves but the demand's; the average is taken over twice as many bins and one.
TREND_BINS = 30
# A wave is followed over these distances, in cells: 49 to 195 m.
WAVE_CELLS = (8, 16, 24, 32)
# How far the lag over the first distance may be from none, and over each further one from what the last one leads to;
# a wider search would take the next wave for the same one.
FIRST_LAG_BINS, FURTHER_LAG_BINS = 6, 3
# How far simulated figures may be off the measured ones.
MEAN_PERCENT = 5.0
QUARTER_PERCENT = 10.0
SLOW_POINTS = 3.0
WAVE_PERCENT = 20.0


@dataclass(frozen=True)
class PeriodStatistics:
    """What the traffic of a period was like, all lanes together, space-mean over cells and bins.

    Attributes:
        mean_speed_mps: Distance travelled by all vehicles over the time they spent.
        share_below_4mps: Share of the cells slower than 4 m/s.
        wave_mps: Speed at which changes of speed travel upstream; nan if none are seen.
    """

    mean_speed_mps: float
    flow_veh_per_h: float
    density_veh_per_km_lane: float
    quarter_speed_mps: tuple[float, ...]
    quarter_flow_veh_per_h: tuple[float, ...]
    share_below_4mps: float
    wave_mps: float

    @property
    def lanes(self) -> int:
        """How many lanes the figures are of: the flow is density times speed on each."""
        return round(self.flow_veh_per_h / (3.6 * self.mean_speed_mps * self.density_veh_per_km_lane))


def period_statistics(pieces: Sequence[Fields], lanes: int) -> PeriodStatistics:
    """Return the figures of one period.

    Args:
        pieces: Fields of the period: one if it was recorded, one for each seed if it was simulated.
    """
    flow = np.concatenate([piece.flow_veh_per_s for piece in pieces], axis=1)
    density = np.concatenate([piece.density_veh_per_m for piece in pieces], axis=1)
    speed = np.concatenate([piece.speed_mps for piece in pieces], axis=1)
    quarters = list(zip(np.array_split(flow, QUARTERS, axis=0), np.array_split(density, QUARTERS, axis=0), strict=True))
    return PeriodStatistics(
        mean_speed_mps=float(flow.mean() / density.mean()),
        flow_veh_per_h=float(3600.0 * flow.mean()),
        density_veh_per_km_lane=float(1000.0 * density.mean() / lanes),
        quarter_speed_mps=tuple(float(q.mean() / k.mean()) for q, k in quarters),
        quarter_flow_veh_per_h=tuple(float(3600.0 * q.mean()) for q, _ in quarters),
        share_below_4mps=float(np.mean(speed[np.isfinite(speed)] < SLOW_MPS)),
        wave_mps=wave_speed([piece.speed_mps for piece in pieces]),
    )


@dataclass(frozen=True)
class Target:
    """One figure that has to be met; the error is in the tolerance's unit, ``%`` or percentage ``points``."""

    name: str
    simulated: float
    measured: float
    error: float
    tolerance: float
    unit: str

    @property
    def met(self) -> bool:
        """Whether the figure is within its tolerance; a figure that is not a number is not."""
        return abs(self.error) <= self.tolerance


def targets(simulated: PeriodStatistics, measured: PeriodStatistics) -> tuple[Target, ...]:
    """Compare a simulated period with the measured one."""

    def relative(name: str, first: float, second: float, tolerance: float) -> Target:
        return Target(name, first, second, 100.0 * (first / second - 1.0), tolerance, "%")

    quarters = zip(simulated.quarter_speed_mps, measured.quarter_speed_mps, strict=True)
    slow, measured_slow = 100.0 * simulated.share_below_4mps, 100.0 * measured.share_below_4mps
    return (
        relative("mean speed, m/s", simulated.mean_speed_mps, measured.mean_speed_mps, MEAN_PERCENT),
        relative("flow, veh/h", simulated.flow_veh_per_h, measured.flow_veh_per_h, MEAN_PERCENT),
        relative(
            "density, veh/km/lane", simulated.density_veh_per_km_lane, measured.density_veh_per_km_lane, MEAN_PERCENT
        ),
        *(relative(f"speed in quarter {k}, m/s", *both, QUARTER_PERCENT) for k, both in enumerate(quarters, start=1)),
        Target("cells below 4 m/s, %", slow, measured_slow, slow - measured_slow, SLOW_POINTS, "points"),
        relative("wave speed, m/s", simulated.wave_mps, measured.wave_mps, WAVE_PERCENT),
    )


def wave_speed(speeds: Sequence[FloatArray]) -> float:
    """Return the speed at which changes of speed travel upstream, from the lag between cells some way apart.

    Changes are what is left of each cell's speed when its mean over five minutes about each moment is taken off. For
    each of several growing distances, the lag with the greatest correlation between downstream and upstream cells is
    found near to what the last distance leads to expect, to a fraction of a bin by a parabola through it and its
    neighbours; the speed is the slope of distance over lag. It is nan where no lag stands out or the changes do not
    travel. Speed fields are of shape (cells, bins).
    """
    changes = [_changes(speed) for speed in speeds]
    distances, lags = [], []
    expected, reach = 0, FIRST_LAG_BINS
    for cells in WAVE_CELLS:
        lag = _lag_of_greatest_correlation(changes, cells, range(expected - reach, expected + reach + 1))
        if lag is None:
            break
        distances.append(cells * CELL_M)
        lags.append(lag * BIN_S)
        expected, reach = round(lag * (cells + WAVE_CELLS[0]) / cells), FURTHER_LAG_BINS
    squares = float(np.dot(lags, lags))
    return float(np.dot(distances, lags)) / squares if squares > 0.0 else float("nan")


def _changes(speed: FloatArray) -> FloatArray:
    """Return speed less its moving average over time, the ends mirrored; empty cells count as unchanged."""
    filled = np.where(np.isnan(speed), np.nanmean(speed, axis=1, keepdims=True), speed)
    width = 2 * min(TREND_BINS, speed.shape[1] - 1) + 1
    return np.asarray(filled - uniform_filter1d(filled, width, axis=1, mode="mirror"))


def _lag_of_greatest_correlation(changes: Sequence[FloatArray], cells: int, lags: range) -> float | None:
    """Return by how many bins the upstream cell is behind the downstream one; None if the greatest is at the edge."""
    if max(map(abs, lags)) >= min(change.shape[1] for change in changes):
        return None
    correlation = np.array([_correlation(changes, cells, lag) for lag in lags])
    best = int(correlation.argmax())
    if not 0 < best < len(lags) - 1 or not np.isfinite(correlation[best]):
        return None
    before, at, after = correlation[best - 1 : best + 2]
    return float(lags[best] + 0.5 * (before - after) / (before - 2.0 * at + after))


def _correlation(changes: Sequence[FloatArray], cells: int, lag: int) -> float:
    product = first = second = 0.0
    for change in changes:
        bins = change.shape[1]
        downstream = change[cells:, max(0, -lag) : bins - max(0, lag)]
        upstream = change[:-cells, max(0, lag) : bins - max(0, -lag)]
        product += float((downstream * upstream).sum())
        first += float((downstream**2).sum())
        second += float((upstream**2).sum())
    return product / (first * second) ** 0.5 if first * second > 0.0 else float("nan")
