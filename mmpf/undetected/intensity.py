"""The expected number of undetected vehicles on each piece of lane around the sensor.

In dense traffic most vehicles in a shadow were never seen, so that no track stands for them. Their number is a Poisson
field, as that of undetected targets in Williams (IEEE TAES 2015): it drives with the traffic, comes in where the
sensor's range begins and where lanes do, is thinned wherever the sensor looks and finds nobody, and takes in the
vehicles whose tracks were let go. Before stop lines there are more of them. Misses come in runs: a vehicle in a run
stays overlooked until the run ends. It needs no more than a tracker's scans and tracks, whoever the tracker is.
"""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydantic import Field

from mmpf.map.road import Road
from mmpf.map.sensor_plane import SensorPlane
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, taken
from mmpf.options.base import NotNegative, Positive, Settings, in_unit
from mmpf.scan import Scan, SensorModel
from mmpf.tracks import HIDDEN, Tracks
from mmpf.undetected.apart import BESIDE_LANE_M, Apart, offsets, std_along_m
from mmpf.undetected.cells import CELL_M, LaneCells, cells_of
from mmpf.visibility.depth import Occluders, depth_table
from mmpf.visibility.detection_probability import detection_probabilities
from mmpf.visibility.missed_runs import run_expected
from mmpf.visibility.range_profile import AS_PROMISED, Reach
from mmpf.visibility.shadows import visible_fractions

# Tracks of a greater existence probability hide what is behind them.
CASTS_FROM = 0.5
MIXED_AT_PER_M = 0.03
# Longer steps are driven in several, so that no traffic drives farther than a cell.
LONGEST_STEP_S, MOST_STEPS, MOST_EXCHANGED = 0.1, 100, 0.2
DENSITY_GUESS_S, DENSITY_MEMORY_S = 0.5, 5.0
"""The first guess of the density is worth what is seen in the first time; it is a mean over about the second."""
DENSITY_WITHIN = 0.6
"""Vehicles within this share of the range tell the density."""
FLOW_LENGTH_M = 30.0
"""The weight of a known vehicle's speed for the traffic around falls by e over this distance."""
QUEUE_M, QUEUED = 60.0, 3.0
"""So far before a stop line vehicles queue, and are so many times as dense as elsewhere."""


class UnseenOptions(Settings):
    """Settings of the expected number of undetected vehicles; chosen on tuning seeds."""

    density_per_km: Positive = 20.0
    """Vehicles per kilometre of lane before any traffic was seen."""
    settled_s: NotNegative = 0.3
    """Looks thin the field for good from then on: before, there is not yet a track of everything that hides others."""
    room_m: NotNegative = 5.0
    """No other vehicle's middle is nearer than this to a known one's that stands, along the lane."""
    headway_s: NotNegative = 0.9
    """The room around a known vehicle that drives is longer by what it drives in this time, on average,"""
    headway_std_s: NotNegative = 0.3
    """and drivers differ by so much."""
    spread_m2_per_s: Annotated[NotNegative, in_unit("m²/s")] = 30.0
    """How fast the field spreads along a lane, since drivers differ in speed."""
    mixing_s: Positive = 3.0
    """Hidden traffic is back at the usual density after this time, where that is 30 vehicles per kilometre of lane: by
    drivers' own ways, and by tracks that are confused. The rate grows with the third power of a place's
    usual density.
    """
    run_share: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.12
    """Expected share of time in runs of misses that no shadow explains."""
    run_s: Positive = 0.8
    """Mean length of such a run."""
    length_m: Positive = 4.7
    """Length of the vehicle that is looked for."""
    width_m: Positive = 1.9
    """Its width."""


@dataclass(frozen=True)
class Unseen:
    """The expected number of vehicles without a track on each piece of lane within the sensor's range.

    Attributes:
        cells: The pieces of lane.
        expected: Expected number of vehicles in each, shape (n,).
    """

    cells: LaneCells
    expected: FloatArray


@dataclass
class UnseenTraffic:
    """Updates the expected number of undetected vehicles from scan to scan.

    The field is kept in metres of lane on which traffic is as dense as usual, so that it follows while that density is
    learned; in two rows, vehicles that the sensor may detect and vehicles that it misses in a run.

    Attributes:
        road: The lanes.
        sensor: The sensor's data sheet.
        options: Settings.
    """

    road: Road
    sensor: SensorModel
    options: UnseenOptions = field(default_factory=UnseenOptions)
    _previous: tuple[float, Tracks] | None = None

    def __post_init__(self) -> None:
        self._cells, self._links = cells_of(self.road)
        queued = np.where(self._cells.before_stop_m < QUEUE_M, QUEUED, 1.0)
        self._usual_m = self._cells.length_m * self._cells.share * queued
        self._density_per_m = self.options.density_per_km / 1e3
        self._learned_s = DENSITY_GUESS_S
        missed = self.options.run_share
        self._by_run = np.array([[1.0 - missed], [missed]])
        self._field_m = self._by_run * self._usual_m
        self._watched_s = 0.0
        self._phase_m = np.zeros(int(self._cells.lane.max(initial=0)) + 1)

    def step(self, scan: Scan, tracks: Tracks, reach: Reach | None = None) -> Unseen:
        """Process a scan and the tracks after it.

        Args:
            scan: What the sensor saw.
            tracks: All tracks as they stand after it.
            reach: At which distances vehicles are detected, if the tracker has learned it; the data sheet holds if not.

        Returns:
            The expected numbers within range after the scan.
        """
        if not len(self._cells):
            return Unseen(self._cells, np.zeros(0))
        plane = SensorPlane(scan.ego, self.road)
        near = np.flatnonzero(plane.distance_m(self._cells.lon_m, self._cells.lat_m) <= self.sensor.range_m)
        cells = taken(self._cells, near)
        apart = Apart.between(cells, tracks, scan)
        if self._previous is not None:
            time_s, before = self._previous
            self._watched_s += scan.time_s - time_s
            self._drive_on(near, apart.flow_mps(FLOW_LENGTH_M), scan.time_s - time_s)
            self._take_in(near, _let_go(before, tracks))
        left = self._field_m[:, near]
        left[0] *= self._overlooked(cells, apart, plane, reach)
        if self._watched_s >= self.options.settled_s:
            self._field_m[:, near] = left
        options = self.options
        free = apart.free_share(options.room_m, options.headway_s, options.headway_std_s)
        expected = self._density_per_m * left.sum(axis=0) * free
        if self._previous is not None:
            self._learn_density(near, expected, apart, plane, scan.time_s - self._previous[0])
        self._previous = scan.time_s, tracks
        return Unseen(cells, expected)

    @property
    def density_per_km(self) -> float:
        """Learned number of vehicles, seen and unseen, per kilometre of lane."""
        return 1e3 * self._density_per_m

    def _drive_on(self, near: IntArray, speed_mps: FloatArray, dt_s: float) -> None:
        """Move the field along the lanes and spread it; beyond the range it has the mean density."""
        lanes = len(self._phase_m)
        total = np.bincount(self._cells.lane[near], speed_mps, minlength=lanes)
        speeds = total / np.maximum(np.bincount(self._cells.lane[near], minlength=lanes), 1)
        usual = self._by_run * self._usual_m
        field = usual.copy()
        field[:, near] = self._field_m[:, near]
        steps = min(int(np.ceil(dt_s / LONGEST_STEP_S - 1e-6)), MOST_STEPS)
        for _ in range(steps):
            moves = self._moving(speeds * dt_s / steps)
            field = np.stack(
                [self._spread(self._moved_on(*row, moves), dt_s / steps) for row in zip(field, usual, strict=True)]
            )
        usual_per_m = self._density_per_m * self._usual_m / self._cells.length_m
        mixing_per_s = (usual_per_m / MIXED_AT_PER_M) ** 3 / self.options.mixing_s
        field -= np.expm1(-mixing_per_s * dt_s) * (usual - field)
        self._field_m = self._after_runs(field, dt_s)

    def _after_runs(self, field_m: FloatArray, dt_s: float) -> FloatArray:
        """Return the field after runs of misses have begun and ended, shape (2, n)."""
        options, everybody = self.options, field_m.sum(axis=0)
        missed = field_m[1] / np.maximum(everybody, 1e-300)
        missed = everybody * run_expected(missed, options.run_share, options.run_s, dt_s)
        return np.stack([everybody - missed, missed])

    def _moving(self, driven_m: FloatArray) -> BoolArray:
        """Return the cells of lanes that have travelled one cell; moved by shares of one, traffic would spread out."""
        cells = self._cells
        self._phase_m += driven_m
        moves = self._phase_m[cells.lane] >= cells.length_m
        self._phase_m[cells.lane[moves]] = np.minimum(self._phase_m[cells.lane] - cells.length_m, CELL_M)[moves]
        return np.asarray(moves)

    def _moved_on(self, field_m: FloatArray, usual_m: FloatArray, moves: BoolArray) -> FloatArray:
        """Return a field after the traffic of some cells has moved; the mean density enters where lanes begin."""
        cells, links = self._cells, self._links
        leaving = np.where(moves, field_m, 0.0)
        arriving = np.bincount(links.target, leaving[links.source] * links.share, minlength=len(cells))
        arriving[cells.entry] += np.where(moves, usual_m, 0.0)[cells.entry]
        return np.asarray(field_m + arriving - leaving)

    def _spread(self, field_m: FloatArray, dt_s: float) -> FloatArray:
        """Return the field after diffusion between neighbouring cells."""
        links, usual = self._links, self._usual_m
        share = min(self.options.spread_m2_per_s * dt_s / CELL_M**2, MOST_EXCHANGED)
        dense = field_m / usual
        exchanged = share * np.minimum(usual[links.source] * links.share, usual[links.target])
        exchanged = exchanged * (dense[links.source] - dense[links.target])
        given = np.bincount(links.source, exchanged, minlength=len(field_m))
        return np.asarray(field_m - given + np.bincount(links.target, exchanged, minlength=len(field_m)))

    def _take_in(self, near: IntArray, lost: Tracks) -> None:
        """Add the vehicles of removed tracks to the field, spread as widely as their tracks."""
        if not len(lost) or not len(near):
            return
        cells = taken(self._cells, near)
        along, across = offsets(cells, lost.lon_m, lost.lat_m)
        std = np.maximum(np.hypot(std_along_m(cells, lost), 0.5 * cells.length_m[:, None]), 1e-3)
        density = np.exp(-0.5 * (along / std) ** 2) / (np.sqrt(2.0 * np.pi) * std)
        density *= np.abs(across) < BESIDE_LANE_M
        gained = (density * cells.length_m[:, None] * lost.existence).sum(axis=1) / self._density_per_m
        self._field_m[:, near] += self._by_run * gained

    def _overlooked(self, cells: LaneCells, apart: Apart, plane: SensorPlane, reach: Reach | None) -> FloatArray:
        """Return the probability that the sensor, outside a run of misses, has missed a vehicle in each cell, (n,)."""
        options, tracks = self.options, apart.tracks
        size = len(tracks) + 1
        turn = self.road.axis_of(np.append(apart.heading_rad, 0.0))
        bodies = Occluders(np.full(size, options.length_m), np.full(size, options.width_m), turn)
        casts = np.append((tracks.existence >= CASTS_FROM) & apart.known, False)
        lon, lat = np.append(tracks.lon_m, 0.0), np.append(tracks.lat_m, 0.0)
        table = depth_table(plane, lon, lat, casts, bodies)
        looked_for = np.full(len(cells), size - 1)
        visible = visible_fractions(plane, cells.lon_m, cells.lat_m, looked_for, bodies, table)
        distance = plane.distance_m(cells.lon_m, cells.lat_m)
        shares = AS_PROMISED if reach is None else reach.shares()
        detected = detection_probabilities(visible, distance, self.sensor, shares, 0.0)
        return 1.0 - detected

    def _learn_density(
        self, near: IntArray, expected: FloatArray, apart: Apart, plane: SensorPlane, dt_s: float
    ) -> None:
        within_m = DENSITY_WITHIN * self.sensor.range_m
        inside = plane.distance_m(self._cells.lon_m[near], self._cells.lat_m[near]) <= within_m
        lane_m = float(self._usual_m[near][inside].sum())
        if lane_m <= 0.0:
            return
        tracks = apart.tracks
        counts = apart.known & (plane.distance_m(tracks.lon_m, tracks.lat_m) <= within_m)
        tracked = float(tracks.existence[counts].sum())
        seen_per_m = (1.0 + tracked + float(expected[inside].sum())) / lane_m
        self._learned_s = min(self._learned_s + dt_s, DENSITY_MEMORY_S)
        self._density_per_m += min(dt_s / self._learned_s, 1.0) * (seen_per_m - self._density_per_m)


def _let_go(before: Tracks, now: Tracks) -> Tracks:
    """Return the hidden tracks that have been removed."""
    still = (before.track_id[:, None] == now.track_id).any(axis=1)
    return taken(before, (before.state == HIDDEN) & ~still)
