"""Input of the multi-object metrics: truth identities, track identities and their similarities."""

from dataclasses import dataclass

import numpy as np

from harness.scoring.evidence.history import DetectionHistory, first_of_group, last_row_where
from harness.scoring.evidence.matching import gate_match
from harness.scoring.evidence.pairs import GATE_SIMILARITY, TrackPairs, pairs_near
from harness.scoring.evidence.rows import RunRows
from harness.scoring.evidence.rules import GATE_LON_M, IN_SIGHT_S, TIME_TOLERANCE_S
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class MotSequence:
    """A sequence of truth and tracks, struct of arrays.

    Attributes:
        steps: Number of steps.
        truth_step: Step of each truth row, shape (n,).
        truth_identity: Identity of each truth row, from 0, shape (n,).
        track_step: Step of each track row, shape (m,).
        track_identity: Identity of each track row, from 0, shape (m,).
        pair_truth: Truth row of each pair with a similarity above 0, shape (p,).
        pair_track: Track row of each pair, same step as the truth row, shape (p,).
        pair_similarity: Similarity of each pair in (0, 1], shape (p,).
        pair_distance_m: Euclidean distance of each pair, shape (p,).
    """

    steps: int
    truth_step: IntArray
    truth_identity: IntArray
    track_step: IntArray
    track_identity: IntArray
    pair_truth: IntArray
    pair_track: IntArray
    pair_similarity: FloatArray
    pair_distance_m: FloatArray


@dataclass(frozen=True)
class Selection:
    """Which truth rows, shape (n,), and track rows, shape (m,), a sequence is made of."""

    truth: BoolArray
    tracks: BoolArray


def select_in_sight(rows: RunRows, history: DetectionHistory, pairs: TrackPairs) -> Selection:
    """Select the vehicles in sight; tracks that are out of sight and match none of them are left out.

    One rule decides for the tracks of every tracker, and from the detections alone: see ``tracks_in_sight``. A track
    on a vehicle that is out of sight but remembered, or detected too few times yet, is left out too, however near the
    detections of others lie: it is right, of a vehicle that does not count here.
    A vehicle beyond the sensor's range is ignored: neither it nor the track on it counts. Nor does a track beyond what
    the source knows of the road, unless it is on a vehicle that counts.
    """
    in_sight = history.in_sight()
    chosen = gate_match(pairs, in_sight)
    tracks = tracks_in_sight(rows) & ~rows.tracks.unknowable
    free = np.ones(len(tracks), dtype=bool)
    free[chosen.track] = False
    others = history.remembered() & ~in_sight
    tracks[gate_match(pairs.where(free[pairs.track]), others).track] = False
    tracks[chosen.track] = rows.truth.in_range[chosen.truth]
    return Selection(in_sight & rows.truth.in_range, tracks)


def tracks_in_sight(rows: RunRows, new_ones: bool = True) -> BoolArray:
    """Return which reported tracks are in sight, shape (m,) along ``TrackRows``.

    The detections alone decide, never what a tracker says of itself.
    A track is out of sight once no detection has lain within the gate of its reported place for more than
    ``IN_SIGHT_S``, the time after which a vehicle without detections is out of sight as well. The time counts from the
    last step at which the track had such a detection, or from the first at which it was reported if it never had one;
    without ``new_ones`` such a track is never in sight, so that a new identity does not bring a false track back.
    Clutter counts like any detection, since no tracker can tell it apart.
    """
    tracks = rows.tracks
    near = pairs_near(rows.detections, tracks, GATE_LON_M)
    has_detection = np.zeros(len(tracks), dtype=bool)
    has_detection[near.track[near.similarity >= GATE_SIMILARITY]] = True
    order = np.lexsort((tracks.step, tracks.track))
    track, time_s = tracks.track[order], rows.time_s[tracks.step[order]]
    since_row = last_row_where(has_detection[order] | (first_of_group(track) & new_ones), track)
    in_sight = np.zeros(len(tracks), dtype=bool)
    in_sight[order] = (since_row >= 0) & (time_s - time_s[since_row] <= IN_SIGHT_S + TIME_TOLERANCE_S)
    return in_sight


def select_remembered(rows: RunRows, history: DetectionHistory, pairs: TrackPairs) -> Selection:
    """Select the vehicles detected within the memory; every reported track counts.

    A vehicle beyond the sensor's range is ignored: neither it nor the track on it counts. Nor does a track beyond what
    the source knows of the road, unless it is on a vehicle that counts.
    """
    remembered = history.remembered()
    chosen = gate_match(pairs, remembered)
    tracks = ~rows.tracks.unknowable
    tracks[chosen.track] = rows.truth.in_range[chosen.truth]
    return Selection(remembered & rows.truth.in_range, tracks)


def mot_sequence(rows: RunRows, history: DetectionHistory, pairs: TrackPairs, selection: Selection) -> MotSequence:
    """Take the selected rows out of the run and number their identities from 0."""
    kept = pairs.where(selection.truth[pairs.truth] & selection.tracks[pairs.track])
    truth_place = np.cumsum(selection.truth) - 1
    track_place = np.cumsum(selection.tracks) - 1
    return MotSequence(
        steps=len(rows.time_s),
        truth_step=rows.truth.step[selection.truth],
        truth_identity=np.unique(history.identity[selection.truth], return_inverse=True)[1],
        track_step=rows.tracks.step[selection.tracks],
        track_identity=np.unique(rows.tracks.track[selection.tracks], return_inverse=True)[1],
        pair_truth=truth_place[kept.truth],
        pair_track=track_place[kept.track],
        pair_similarity=kept.similarity,
        pair_distance_m=np.hypot(
            rows.truth.lon_m[kept.truth] - rows.tracks.lon_m[kept.track],
            rows.truth.lat_m[kept.truth] - rows.tracks.lat_m[kept.track],
        ),
    )
