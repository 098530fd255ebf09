"""Which track belongs to which vehicle: by the gate where it is visible, by identity where it is hidden."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from harness.scoring.evidence.assignment import best_assignment
from harness.scoring.evidence.history import DetectionHistory, last_row_where
from harness.scoring.evidence.pairs import GATE_SIMILARITY, TrackPairs
from harness.scoring.evidence.rows import RunRows
from harness.scoring.evidence.rules import IN_SIGHT_S, TIME_TOLERANCE_S
from harness.storage.schema import PARTIAL, VISIBLE
from mmpf.numerics.arrays import BoolArray, IntArray

HOLD_S = 0.5
"""A track holds a vehicle at its last detection if it was matched to it at most this long before."""


@dataclass(frozen=True)
class Matching:
    """Matches along the rows of truth and of tracks.

    Attributes:
        track_row: Row of the track matched to each truth row by the gate, -1 if none, shape (n,).
        truth_row: Row of the vehicle matched to each track row by the gate, -1 if none, shape (m,).
        holder: Track (a code as in ``TrackRows.track``) that held the vehicle when it was last detected, -1 if none,
            shape (n,).
        holder_row: Row of that track at the step of each truth row, -1 if it is not reported there, shape (n,).
    """

    track_row: IntArray
    truth_row: IntArray
    holder: IntArray
    holder_row: IntArray


def match(rows: RunRows, history: DetectionHistory, pairs: TrackPairs) -> Matching:
    """Match vehicles to tracks at every step.

    Vehicles in range that are visible, partly visible or were detected within ``IN_SIGHT_S`` compete for the tracks:
    the optimal assignment of those within the gate, which maximises the sum of similarities. The holder of a vehicle is
    the track that was last matched to it no later than its last detection and at most ``HOLD_S`` before that.
    """
    truth, tracks = rows.truth, rows.tracks
    lately = history.since_s <= IN_SIGHT_S + TIME_TOLERANCE_S
    seen = truth.in_range & ((truth.state == VISIBLE) | (truth.state == PARTIAL) | lately)
    chosen = gate_match(pairs, seen)
    track_row = np.full(len(truth), -1)
    track_row[chosen.truth] = chosen.track
    truth_row = np.full(len(tracks), -1)
    truth_row[chosen.track] = chosen.truth

    match_row = last_row_where(track_row >= 0, truth.vehicle)
    match_row = np.where(history.last_row >= 0, match_row[history.last_row], -1)
    held = match_row >= 0
    held[held] = truth.time_s[history.last_row[held]] - truth.time_s[match_row[held]] <= HOLD_S + TIME_TOLERANCE_S
    holder = np.full(len(truth), -1)
    holder[held] = tracks.track[track_row[match_row[held]]]
    return Matching(track_row, truth_row, holder, find_track_rows(rows, truth.step, holder))


def gate_match(pairs: TrackPairs, candidate: BoolArray) -> TrackPairs:
    """Return the optimal assignment within the gate of the truth rows that are candidates, shape of candidate (n,)."""
    within = pairs.where((pairs.similarity >= GATE_SIMILARITY) & candidate[pairs.truth])
    return within.where(best_assignment(within.truth, within.track, within.similarity))


def find_track_rows(rows: RunRows, step: IntArray, track: IntArray) -> IntArray:
    """Return the row of each track (code, or -1) at each step, -1 where it is not reported; arrays of one shape."""
    tracks = rows.tracks
    steps = len(rows.time_s)
    found = pd.Index(tracks.track * steps + tracks.step).get_indexer(pd.Index(track * steps + step))
    return np.asarray(found, dtype=np.int64)
