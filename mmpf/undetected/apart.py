"""Where known vehicles are relative to lane pieces, and where they leave no room for others."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.special import ndtr

from mmpf.numerics.arrays import BoolArray, FloatArray, turned
from mmpf.scan import Scan
from mmpf.tracks import TENTATIVE, Tracks
from mmpf.undetected.cells import LaneCells

BESIDE_LANE_M = 2.0
# What is farther off than this many deviations does not count.
FARTHEST_STD = 4.0


@dataclass(frozen=True)
class Apart:
    """How far tracks, m of them, are from the middles of n cells along and across each cell's lane.

    Attributes:
        along_m: Shape (n, m + 1); the ego is the last.
        across_m: Likewise.
        tracks: The tracks.
        known: Which of them are more than tentative, shape (m,).
        heading_rad: Direction of the lane that each is nearest to, shape (m,).
        ego_speed_mps: The ego's speed.
        std_along_m: Deviation of each one's place along each cell's lane, the ego's last, shape (n, m + 1).
    """

    along_m: FloatArray
    across_m: FloatArray
    tracks: Tracks
    known: BoolArray
    heading_rad: FloatArray
    ego_speed_mps: float
    std_along_m: FloatArray

    @classmethod
    def between(cls, cells: LaneCells, tracks: Tracks, scan: Scan) -> Self:
        """Return how far a scan's tracks and ego are from cells."""
        ego = scan.ego
        along, across = offsets(cells, np.append(tracks.lon_m, ego.lon_m), np.append(tracks.lat_m, ego.lat_m))
        heading = np.zeros(len(tracks))
        if len(cells) and len(tracks):
            heading = cells.heading_rad[np.hypot(along, across)[:, :-1].argmin(axis=0)]
        std = np.maximum(np.column_stack([std_along_m(cells, tracks), np.zeros(len(along))]), 0.1)
        return cls(along, across, tracks, tracks.state != TENTATIVE, heading, ego.speed_mps, std)

    @property
    def _there(self) -> BoolArray:
        """The known vehicles, the ego last."""
        return np.append(self.known, True)

    def flow_mps(self, length_m: float) -> FloatArray:
        """Return the speed of the traffic around each cell, shape (n,)."""
        there = self._there
        speeds = self._speed_mps[there]
        weight = np.exp(-np.hypot(self.along_m[:, there], 3.0 * self.across_m[:, there]) / length_m)
        return np.asarray(np.maximum((weight * speeds).sum(axis=1), 0.0) / np.maximum(weight.sum(axis=1), 1e-12))

    @property
    def _speed_mps(self) -> FloatArray:
        return np.append(self.tracks.speed_mps, self.ego_speed_mps)

    def free_share(self, room_m: float, headway_s: float, headway_std_s: float) -> FloatArray:
        """Return the probability that no known vehicle takes up the place, shape (n,).

        Args:
            room_m: No other vehicle's middle is nearer than this to a known one's that stands.
            headway_s: The room is longer by what a vehicle drives in this time, on average,
            headway_std_s: and drivers differ by so much.
        """
        speed = np.maximum(self._speed_mps, 0.0)
        room = room_m + headway_s * speed
        std = np.hypot(self.std_along_m, headway_std_s * speed)
        existence = np.append(self.tracks.existence, 1.0)
        in_lane = self._there & (np.abs(self.across_m) < BESIDE_LANE_M)
        near = in_lane & (np.abs(self.along_m) < room + FARTHEST_STD * std)
        cell, vehicle = np.nonzero(near)
        along, spread, reach = self.along_m[near], std[near], room[vehicle]
        taken_up = existence[vehicle] * (ndtr((reach - along) / spread) - ndtr((-reach - along) / spread))
        free = np.ones(len(self.along_m))
        np.multiply.at(free, cell, 1.0 - taken_up)
        return free


def offsets(cells: LaneCells, lon_m: FloatArray, lat_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far places are from cells along and across each cell's lane, shape (n, places)."""
    away_lon, away_lat = lon_m - cells.lon_m[:, None], lat_m - cells.lat_m[:, None]
    return turned(away_lon, away_lat, cells.heading_rad[:, None])


def std_along_m(cells: LaneCells, tracks: Tracks) -> FloatArray:
    """Return each track's deviation along each cell's lane, as if independent along the frame's axes, (n, m)."""
    heading = cells.heading_rad[:, None]
    return np.asarray(np.hypot(tracks.std_lon_m * np.cos(heading), tracks.std_lat_m * np.sin(heading)))
