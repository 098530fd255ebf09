"""Occlusion events: a vehicle is hidden and seen again, and whether its track is alive and still its own."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from harness.scoring.evidence.matching import Matching, find_track_rows
from harness.scoring.evidence.plain_view import durations
from harness.scoring.evidence.rows import RunRows
from harness.scoring.evidence.rules import EVENT_JUDGED_S, MEMORY_S, TIME_TOLERANCE_S
from harness.storage.schema import HIDDEN
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

EVENT_S, HIDDEN_SHARE = 0.5, 0.7
"""Shortest time without detection of an event, and the share of it for which the vehicle must be hidden."""
DETECTED_S, HISTORY_S = 1.0, 3.0
"""How long the vehicle must have been detected, each detection lasting a step, within a time before."""
REACQUIRE_LIMIT_S = 5.0
"""Longest time from re-detection to re-acquisition."""


@dataclass(frozen=True)
class OcclusionEvents:
    """Occlusion events with their outcomes, struct of arrays of shape (e,).

    Attributes:
        onset_row: Truth row of the last detection before.
        return_row: Truth row of the re-detection.
        track_id: The track that held the vehicle at the onset, -1 if none.
        hijacked: 0.5 s after re-detection that track is matched to another vehicle.
        lost: It is no longer reported then, or there was none.
        same_id: It is matched to the vehicle then.
        alive_at_return: It is reported and not matched to another vehicle at the very re-detection.
        reacquire_s: Time from re-detection to the first match of the vehicle with it; nan if none within the limit.
    """

    onset_row: IntArray
    return_row: IntArray
    duration_s: FloatArray
    track_id: IntArray
    hijacked: BoolArray
    lost: BoolArray
    same_id: BoolArray
    alive_at_return: BoolArray
    reacquire_s: FloatArray

    @property
    def survived(self) -> BoolArray:
        """Neither lost nor hijacked: the track is alive, on its vehicle or on nothing."""
        return ~self.hijacked & ~self.lost


def occlusion_events(rows: RunRows, matching: Matching) -> OcclusionEvents:
    """Find the occlusion events and judge them.

    An event is a time of ``EVENT_S`` to ``MEMORY_S`` between two successive detections of a vehicle, in which it
    is hidden for at least ``HIDDEN_SHARE`` of the steps, after detections at as many steps as ``DETECTED_S`` has (ten
    at 10 Hz) in the ``HISTORY_S`` up to the first. It is judged ``EVENT_JUDGED_S`` after the second, by the track that
    held the vehicle at the first; if the vehicle is out of range or the episode over by then, it is no event.
    Events are in the order of the truth rows.
    """
    onset, back = _detection_gaps(rows)
    judged = row_after(rows, back, EVENT_JUDGED_S)
    known = (judged >= 0) & rows.truth.in_range[judged]
    onset, back, judged = onset[known], back[known], judged[known]

    old = matching.holder[onset]
    at_judgement = find_track_rows(rows, rows.truth.step[judged], old)
    at_return = find_track_rows(rows, rows.truth.step[back], old)
    vehicle_then = np.append(matching.truth_row, -1)[at_judgement]
    vehicle_at_return = np.append(matching.truth_row, -1)[at_return]
    same_id = (at_judgement >= 0) & (vehicle_then == judged)
    return OcclusionEvents(
        onset_row=onset,
        return_row=back,
        duration_s=rows.truth.time_s[back] - rows.truth.time_s[onset],
        track_id=_track_ids(rows, old),
        hijacked=(vehicle_then >= 0) & (vehicle_then != judged),
        lost=at_judgement < 0,
        same_id=same_id,
        alive_at_return=(at_return >= 0) & ((vehicle_at_return < 0) | (vehicle_at_return == back)),
        reacquire_s=_reacquire_s(rows, matching, back, old),
    )


def event_table(truth: pd.DataFrame, rows: RunRows, events: OcclusionEvents) -> pd.DataFrame:
    """Return the events as the table of that name in ``harness.storage.schema``."""
    onset, back = rows.truth.name_row[events.onset_row], rows.truth.name_row[events.return_row]
    outcome = np.where(events.lost, "lost", np.where(events.hijacked, "hijacked", "survived"))
    step, time_s = truth["step"].to_numpy(), truth["time_s"].to_numpy()
    return pd.DataFrame(
        {
            "episode": rows.episode[rows.truth.step[events.onset_row]],
            "vehicle_id": truth["vehicle_id"].take(onset).to_numpy(),
            "from_step": step[onset],
            "from_s": time_s[onset],
            "to_step": step[back],
            "to_s": time_s[back],
            "duration_s": events.duration_s,
            "track_id": events.track_id,
            "outcome": np.where(events.same_id, "same_id", outcome),
            "reacquire_s": events.reacquire_s,
        }
    )


def _detection_gaps(rows: RunRows) -> tuple[IntArray, IntArray]:
    """Return the truth rows before and after each time without detection that makes an event."""
    truth = rows.truth
    detected = np.flatnonzero(truth.detected)
    onset, back = detected[:-1], detected[1:]
    gap_s = truth.time_s[back] - truth.time_s[onset]
    fits = truth.vehicle[back] == truth.vehicle[onset]
    fits &= (gap_s >= EVENT_S - TIME_TOLERANCE_S) & (gap_s <= MEMORY_S + TIME_TOLERANCE_S)
    place = np.flatnonzero(fits)
    onset, back = onset[place], back[place]

    # Counting whole periods lets a vehicle's detections of the last seconds be one binary search.
    period_s = rows.time_s[-1] - rows.time_s[0] + HISTORY_S + 1.0 if len(rows.time_s) else 1.0
    clock = truth.vehicle * period_s + truth.time_s
    oldest = np.searchsorted(clock[detected], clock[onset] - HISTORY_S + TIME_TOLERANCE_S, side="right")
    usual_s = float(np.median(durations(rows.time_s, rows.episode))) if len(rows.time_s) else DETECTED_S
    enough = place + 1 - oldest >= np.round(DETECTED_S / usual_s)
    hidden = np.append(0, np.cumsum(truth.state == HIDDEN))
    between = back - onset - 1
    hidden_share = (hidden[back] - hidden[onset + 1]) / np.maximum(between, 1)
    enough &= (between > 0) & (hidden_share >= HIDDEN_SHARE - 1e-9)
    return onset[enough], back[enough]


def other_track_after(rows: RunRows, matching: Matching, events: OcclusionEvents) -> BoolArray:
    """Return after which events another track than the old one is on the vehicle when it is judged, shape (e,)."""
    judged = row_after(rows, events.return_row, EVENT_JUDGED_S)
    now = np.where(judged >= 0, matching.track_row[judged], -1)
    old = matching.holder[events.onset_row]
    return np.asarray((old >= 0) & (now >= 0) & (np.append(rows.tracks.track, -1)[now] != old))


def row_after(rows: RunRows, row: IntArray, delay_s: float) -> IntArray:
    """Return the first row of the same vehicle at least the delay later, or -1 if its record ends before."""
    truth = rows.truth
    period_s = rows.time_s[-1] - rows.time_s[0] + delay_s + 1.0 if len(rows.time_s) else 1.0
    clock = truth.vehicle * period_s + truth.time_s
    later = np.searchsorted(clock, clock[row] + delay_s - TIME_TOLERANCE_S)
    inside = later < len(truth)
    inside[inside] = truth.vehicle[later[inside]] == truth.vehicle[row[inside]]
    return np.where(inside, later, -1)


def _reacquire_s(rows: RunRows, matching: Matching, back: IntArray, old: IntArray) -> FloatArray:
    truth = rows.truth
    matched = np.append(rows.tracks.track, -1)[matching.track_row]
    end = np.searchsorted(truth.vehicle, truth.vehicle[back], side="right")
    delay_s = np.full(len(back), np.nan)
    for event in np.flatnonzero(old >= 0):
        hits = np.flatnonzero(matched[back[event] : end[event]] == old[event])
        if len(hits):
            delay_s[event] = truth.time_s[back[event] + hits[0]] - truth.time_s[back[event]]
    delay_s[delay_s > REACQUIRE_LIMIT_S + TIME_TOLERANCE_S] = np.nan
    return delay_s


def _track_ids(rows: RunRows, track: IntArray) -> IntArray:
    """Return the trackers' own numbers of tracks given by code, -1 for -1."""
    codes, first = np.unique(rows.tracks.track, return_index=True)
    numbers = np.append(rows.tracks.track_id[first], -1)
    return numbers[np.where(track >= 0, track, len(codes))]
