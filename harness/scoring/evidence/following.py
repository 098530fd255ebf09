"""Assigns all reported tracks to all known vehicles, one assignment for each step.

The gate decides who stands for whom where both can be seen; a hidden vehicle's track may be metres off and still be the
best that is known of it. So pairs go up to a cut-off, and seen and hidden vehicles compete for the tracks together: a
track that is on a seen vehicle can not serve a hidden one as well. Identity plays no part here.
"""

from dataclasses import dataclass

import numpy as np

from harness.scoring.evidence.assignment import best_assignment
from harness.scoring.evidence.history import DetectionHistory
from harness.scoring.evidence.pairs import GATE_SIMILARITY, pairs_near
from harness.scoring.evidence.rows import RunRows
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M, GATE_LON_M, IN_SIGHT_DETECTIONS
from harness.storage.schema import HIDDEN, OUT
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Following:
    """The assignment that makes the sum of the vehicles' distances to their tracks least, each at most the cut-off.

    Attributes:
        counted: Vehicles that a tracker is asked for, shape (n,) along ``TruthRows``; see ``once_seen``.
        hidden: Those of them that are hidden, shape (n,).
        distance_m: Distance of each vehicle's track, the cut-off where nobody follows it, shape (n,).
        track_row: Row of that track, -1 if none, shape (n,).
        idle: Reported tracks that follow nobody, shape (m,) along ``TrackRows``.
    """

    counted: BoolArray
    hidden: BoolArray
    distance_m: FloatArray
    track_row: IntArray
    idle: BoolArray


def once_seen(rows: RunRows, history: DetectionHistory) -> BoolArray:
    """Return which vehicles count for trackers, shape (n,): detections decide, not tracks.

    These are the vehicles in range that have been detected ``IN_SIGHT_DETECTIONS`` times, the last time at most
    ``MEMORY_S`` ago.
    """
    often = history.count >= IN_SIGHT_DETECTIONS
    present = rows.truth.in_range & np.not_equal(rows.truth.state, OUT)
    return history.remembered() & often & present


def follow(rows: RunRows, history: DetectionHistory) -> Following:
    """Assign tracks to vehicles step by step.

    A vehicle that was detected but is not asked for (too seldom, too long ago, out of range) takes a track within the
    gate, which then neither serves another vehicle nor follows no vehicle. A track beyond what the source knows of the
    road never follows no vehicle.
    """
    truth, tracks = rows.truth, rows.tracks
    counted = once_seen(rows, history)
    near = pairs_near(truth, tracks, max(FOLLOW_CUTOFF_M, GATE_LON_M))
    away_m = np.hypot(
        truth.lon_m[near.truth] - tracks.lon_m[near.track], truth.lat_m[near.truth] - tracks.lat_m[near.track]
    )
    excused = (history.last_row[near.truth] >= 0) & (near.similarity >= GATE_SIMILARITY)
    kept = (counted[near.truth] | excused) & (away_m < FOLLOW_CUTOFF_M)
    vehicle, track, away_m = near.truth[kept], near.track[kept], away_m[kept]
    chosen = best_assignment(vehicle, track, FOLLOW_CUTOFF_M - away_m)
    distance_m = np.full(len(truth), FOLLOW_CUTOFF_M)
    distance_m[vehicle[chosen]] = away_m[chosen]
    track_row = np.full(len(truth), -1)
    track_row[vehicle[chosen]] = track[chosen]
    idle = ~tracks.unknowable
    idle[track[chosen]] = False
    return Following(counted, counted & (truth.state == HIDDEN), distance_m, track_row, idle)
