"""Missed and phantom brakings: where the driver decides differently by the tracks than by the truth, and why.

A braking is missed where by the truth the driver brakes and by the tracks it does not, for half a second or more; it is
a phantom the other way round. For a vehicle in plain view that the tracker withholds a braking is missed more readily,
see ``withheld``. To blame is the vehicle ahead without which the driver would brake least: for a missed
braking by the truth, for a phantom by the tracks. What is told of it is as of the step at which the two differ most.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from harness.decisions.decide import most_decisive
from harness.scoring.driving.asked import Asked
from harness.scoring.driving.withheld import find_withheld
from harness.scoring.evidence.following import Following
from harness.scoring.evidence.history import DetectionHistory
from harness.scoring.evidence.matching import Matching
from harness.scoring.evidence.plain_view import PlainView
from harness.scoring.evidence.rows import RunRows
from harness.scoring.evidence.rules import BRAKES_MPS2, ROLLS_MPS2
from harness.scoring.evidence.stretches import lasting_stretches, missed_stretches
from harness.storage.schema import BRAKING_KINDS, FATES, VISIBILITY_STATES
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

MISSED, PHANTOM = range(2)
NONE, LOST, DISPLACED, HIJACKED, GHOST = range(5)
MISSED_FATES, PHANTOM_FATES = (NONE, LOST, DISPLACED, HIJACKED), (DISPLACED, HIJACKED, GHOST)
"""What the track to blame, or that of the vehicle to blame, did; ``docs/explanation/driving.md`` tells them apart."""


@dataclass(frozen=True)
class Brakings:
    """The missed and phantom brakings of a run, struct of arrays of shape (b,).

    Attributes:
        kind: Index into ``BRAKING_KINDS``.
        worst: Step between ``first`` and ``last`` at which truth and tracks differ most.
        truth_row: Row of ``TruthRows`` of the vehicle to blame at that step, -1 where there is none.
        track_row: Row of ``TrackRows`` of the track to blame or of the one on that vehicle, -1 where there is none.
        fate: Index into ``FATES``.
        withheld: Whether the vehicle to blame was withheld in plain view at that step.
    """

    kind: IntArray
    first: IntArray
    last: IntArray
    worst: IntArray
    truth_row: IntArray
    track_row: IntArray
    fate: IntArray
    withheld: BoolArray

    def __len__(self) -> int:
        return len(self.kind)


def find_brakings(
    asked: Asked,
    rows: RunRows,
    matching: Matching,
    following: Following,
    plain: PlainView,
) -> Brakings:
    """Find the missed and phantom brakings, those missed first, each kind in order of time."""
    by_truth, by_tracks = asked.truth.command.accel_mps2, asked.tracks.command.accel_mps2
    ahead = find_withheld(asked, rows, matching, plain)
    found: list[tuple[IntArray | BoolArray, ...]] = []
    for kind, (needed, done) in ((MISSED, (by_truth, by_tracks)), (PHANTOM, (by_tracks, by_truth))):
        differ = asked.judged & (needed <= BRAKES_MPS2) & (done > ROLLS_MPS2)
        if kind == MISSED:
            first, last = missed_stretches(
                differ, asked.judged & ahead.misses(needed, done), rows.episode, asked.step_s
            )
        else:
            first, last = lasting_stretches(differ, rows.episode, asked.step_s)
        worst = np.array(
            [a + int(np.argmax((done - needed)[a : b + 1])) for a, b in zip(first, last, strict=True)], dtype=np.int64
        )
        blame = _blamed_vehicles if kind == MISSED else _blamed_tracks
        blamed = blame(asked, worst, matching, following)
        of_withheld = ahead.decisive[worst] & (kind == MISSED)
        found.append((np.full(len(first), kind), first, last, worst, *blamed, of_withheld))
    return Brakings(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _blamed_vehicles(
    asked: Asked, step: IntArray, matching: Matching, following: Following
) -> tuple[IntArray, IntArray, IntArray]:
    """Return for each missed braking the vehicle to blame, the track on it and what that track did."""
    vehicle = most_decisive(asked.driver, asked.truth.belief)[step]
    known = vehicle >= 0
    follower = np.where(known, np.append(following.track_row, -1)[vehicle], -1)
    holder = np.where(known, np.append(matching.holder, -1)[vehicle], -1)
    holder_row = np.where(known, np.append(matching.holder_row, -1)[vehicle], -1)
    on = np.where(holder_row >= 0, np.append(matching.truth_row, -1)[holder_row], -1)
    fate = np.select(
        [follower >= 0, holder < 0, holder_row < 0, (on >= 0) & (on != vehicle)],
        [DISPLACED, NONE, LOST, HIJACKED],
        DISPLACED,
    )
    return vehicle, np.where(follower >= 0, follower, holder_row), fate


def _blamed_tracks(
    asked: Asked, step: IntArray, matching: Matching, following: Following
) -> tuple[IntArray, IntArray, IntArray]:
    """Return for each phantom braking the vehicle that the track to blame follows, that track and what it did."""
    body = most_decisive(asked.driver, asked.tracks.belief)[step]
    track = np.where(body >= 0, np.append(asked.track_row, -1)[body], -1)
    follows = np.full(len(following.idle) + 1, -1)
    has = np.flatnonzero(following.track_row >= 0)
    follows[following.track_row[has]] = has
    vehicle = np.where(track >= 0, follows[track], -1)
    held = np.full(len(following.idle) + 1, -1)
    holding = np.flatnonzero(matching.holder_row >= 0)
    held[matching.holder_row[holding]] = holding
    holds = np.where(track >= 0, held[track], -1)
    fate = np.select([(holds >= 0) & (vehicle >= 0) & (holds != vehicle), vehicle >= 0], [HIJACKED, DISPLACED], GHOST)
    return vehicle, track, fate


def braking_table(
    truth: pd.DataFrame, brakings: Brakings, asked: Asked, rows: RunRows, history: DetectionHistory
) -> pd.DataFrame:
    """Return the table ``brakings`` of ``harness.storage.schema``, in the order in which they begin."""
    some = brakings.truth_row >= 0
    name = np.full(len(brakings), "", dtype=object)
    name[some] = truth["vehicle_id"].to_numpy(dtype=object)[rows.truth.name_row[brakings.truth_row[some]]]
    visibility = np.full(len(brakings), "", dtype=object)
    visibility[some] = np.array(VISIBILITY_STATES, dtype=object)[rows.truth.state[brakings.truth_row[some]]]
    unseen = np.where(some, np.append(history.since_s, np.nan)[brakings.truth_row], np.nan)
    table = pd.DataFrame(
        {
            "kind": np.array(BRAKING_KINDS, dtype=object)[brakings.kind],
            "episode": rows.episode[brakings.first],
            "from_step": rows.step[brakings.first],
            "to_step": rows.step[brakings.last],
            "step": rows.step[brakings.worst],
            "duration_s": rows.time_s[brakings.last] - rows.time_s[brakings.first] + asked.step_s[brakings.last],
            "truth_mps2": _rounded(asked.truth.command.accel_mps2[brakings.worst]),
            "tracks_mps2": _rounded(asked.tracks.command.accel_mps2[brakings.worst]),
            "vehicle_id": name,
            "visibility": visibility,
            "unseen_s": np.where(np.isfinite(unseen), unseen, np.nan),
            "track_id": np.append(rows.tracks.track_id, -1)[brakings.track_row],
            "fate": np.array(FATES, dtype=object)[brakings.fate],
        }
    )
    return table.sort_values("from_step", kind="stable", ignore_index=True)


def command_table(asked: Asked, rows: RunRows) -> pd.DataFrame:
    """Return the table ``commands`` of ``harness.storage.schema``: what the driver would do at each step."""
    columns: dict[str, object] = {
        "step": rows.step,
        "time_s": rows.time_s,
        "episode": rows.episode,
        "judged": asked.judged,
    }
    for name, decision in (("truth", asked.truth), ("tracks", asked.tracks)):
        columns[f"{name}_mps2"] = _rounded(decision.command.accel_mps2)
        columns[f"{name}_gap_m"] = _rounded(decision.belief.leader.gap_m)
        columns[f"{name}_left"] = decision.command.accepts_left
        columns[f"{name}_right"] = decision.command.accepts_right
    return pd.DataFrame(columns)


def _rounded(values: FloatArray) -> FloatArray:
    return np.round(values, 4)
