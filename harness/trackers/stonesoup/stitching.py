"""Identity stitching: a vehicle that is seen again gets its old identity, for any tracker."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.optimize import linear_sum_assignment

from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, joined, taken
from mmpf.options.base import Positive, Settings, in_unit
from mmpf.tracks import TENTATIVE, Tracks

_UNMATCHED_COST = 1e6
_LAT_GATE_M = 1.8
"""Largest lateral distance between a new track and the prediction of an old one."""


class StitchingOptions(Settings):
    """When a new track is an old one come back."""

    unseen_s: Positive = 0.2
    """Shortest time without detections of the old track."""
    overlap_s: Annotated[float, Field(ge=0.0)] = 0.5
    """The old track must have been last seen before this long after the new track's first detection."""
    gate_std: Positive = 3.0
    """Largest longitudinal distance, in standard deviations of the old track's prediction; see ``margin_m``."""
    margin_m: Annotated[float, Field(ge=0.0)] = 3.0
    """Added to that distance, since the centres of two cars are at least one length apart."""
    remember_s: Positive = 10.0
    """An ended track is remembered for this long after its last detection."""
    largest_std_lon_m: Positive = 8.0
    """An ended track is remembered until its prediction's spread exceeds this."""
    speed_noise: Annotated[Positive, in_unit("m²/s³")] = 1.0
    """Growth of a remembered track's speed variance."""


@dataclass(frozen=True)
class LastSightings:
    """Times of the first and last detection of a tracker's tracks, in their order, each of shape (m,)."""

    first_s: FloatArray
    last_s: FloatArray


@dataclass(frozen=True)
class _Snapshot:
    """Confirmed tracks, each at its own time, under the tracker's own identities."""

    tracks: Tracks
    last_seen_s: FloatArray
    time_s: FloatArray


class IdentityStitcher:
    """Hands the identities of lost tracks on to the new tracks that continue them."""

    def __init__(self, options: StitchingOptions) -> None:
        self._options = options
        self._reported_id: dict[int, int] = {}
        self._remembered = _Snapshot(Tracks.none(), np.zeros(0), np.zeros(0))

    def stitch(self, tracks: Tracks, sightings: LastSightings, time_s: float) -> tuple[Tracks, IntArray]:
        """Match newly confirmed tracks to lost ones and rename them.

        Returns:
            Tracks under their stitched identities, and the tracker's own identities of those that were replaced; it
            should drop them.
        """
        confirmed = tracks.state != TENTATIVE
        known = np.array([own in self._reported_id for own in tracks.track_id.tolist()], dtype=np.bool_)
        new = np.flatnonzero(confirmed & ~known)
        lost = self._lost_tracks(tracks, known, sightings, time_s)
        replaced = self._hand_on_identities(tracks, sightings, new, lost)
        for own in tracks.track_id[new].tolist():
            self._reported_id.setdefault(own, own)
        keep = ~np.isin(tracks.track_id, replaced)
        self._remember(taken(tracks, keep & confirmed), sightings.last_s[keep & confirmed], replaced, time_s)
        reported = [self._reported_id.get(own, own) for own in tracks.track_id[keep].tolist()]
        renamed = replace(taken(tracks, keep), track_id=np.array(reported, dtype=np.int64))
        return renamed, replaced

    def _lost_tracks(self, tracks: Tracks, known: BoolArray, sightings: LastSightings, time_s: float) -> _Snapshot:
        """Return the unseen tracks where they should be now: those that still coast and those that ended."""
        options = self._options
        coasting = known & (time_s - sightings.last_s >= options.unseen_s - 1e-6)
        ended = self._ended(tracks.track_id, time_s)
        gone, age_s = ended.tracks, time_s - ended.time_s
        spread = np.sqrt(gone.std_lon_m**2 + (gone.std_speed_mps * age_s) ** 2 + options.speed_noise * age_s**3 / 3)
        gone = replace(gone, lon_m=gone.lon_m + gone.speed_mps * age_s, std_lon_m=spread)
        still = taken(tracks, coasting)
        coast = _Snapshot(still, sightings.last_s[coasting], np.full(len(still), time_s))
        return joined(coast, replace(ended, tracks=gone))

    def _ended(self, present: IntArray, time_s: float) -> _Snapshot:
        remembered, options = self._remembered, self._options
        age_s = time_s - remembered.time_s
        spread = np.hypot(remembered.tracks.std_lon_m, remembered.tracks.std_speed_mps * age_s)
        keep = (
            ~np.isin(remembered.tracks.track_id, present)
            & (time_s - remembered.last_seen_s <= options.remember_s)
            & (spread <= options.largest_std_lon_m)
        )
        return taken(remembered, keep)

    def _hand_on_identities(self, tracks: Tracks, sightings: LastSightings, new: IntArray, lost: _Snapshot) -> IntArray:
        """Match one to one, nearest first over all; return the own identities of the lost tracks that were matched."""
        if not len(new) or not len(lost.tracks.track_id):
            return np.zeros(0, dtype=np.int64)
        options = self._options
        reach = options.gate_std * np.hypot(lost.tracks.std_lon_m, tracks.std_lon_m[new, None]) + options.margin_m
        distance = np.abs(tracks.lon_m[new, None] - lost.tracks.lon_m)
        possible = (
            (distance < reach)
            & (np.abs(tracks.lat_m[new, None] - lost.tracks.lat_m) < _LAT_GATE_M)
            & (lost.last_seen_s <= sightings.first_s[new, None] + options.overlap_s)
        )
        rows, columns = linear_sum_assignment(np.where(possible, distance / reach, _UNMATCHED_COST))
        matched = possible[rows, columns]
        for row, column in zip(rows[matched].tolist(), columns[matched].tolist(), strict=True):
            heir, ancestor = int(tracks.track_id[new[row]]), int(lost.tracks.track_id[column])
            self._reported_id[heir] = self._reported_id[ancestor]
        return np.asarray(lost.tracks.track_id[columns[matched]])

    def _remember(self, tracks: Tracks, last_seen_s: FloatArray, replaced: IntArray, time_s: float) -> None:
        ended = self._ended(tracks.track_id, time_s)
        ended = taken(ended, ~np.isin(ended.tracks.track_id, replaced))
        self._remembered = joined(ended, _Snapshot(tracks, last_seen_s, np.full(len(tracks), time_s)))
