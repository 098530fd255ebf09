"""Why two runs on the same detections differ: the cause of each identity switch and each lost track.

Causes follow from the reported tracks alone, so that all trackers are judged alike. The vehicle's previous track

- *merge*: ended next to a track that continued;
- *death*: ended with no other track nearby;
- *association*: continues on another vehicle, or an older track replaced it in view;
- *birth*: continues without a vehicle, and a newer track replaced it in view;
- *re-identification*: continues without a vehicle, which returned after over 0.5 s unseen with another identity.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from urllib.parse import quote

import numpy as np

from harness.scoring.evidence.directions import along_and_across
from harness.scoring.evidence.errors import LOST, scored_rows
from harness.scoring.evidence.matching import find_track_rows
from harness.scoring.evidence.pairs import GATE_SIMILARITY, similarity
from harness.scoring.evidence.rules import IN_SIGHT_S, TIME_TOLERANCE_S
from harness.scoring.evidence.sequence import select_in_sight
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.clear import clear_matches
from harness.storage.schema import HIDDEN
from mmpf.numerics.arrays import IntArray

BIRTH, ASSOCIATION, MERGE, REIDENTIFICATION, DEATH = "birth", "association", "merge", "re-identification", "death"
CAUSES = (BIRTH, ASSOCIATION, MERGE, REIDENTIFICATION, DEATH)
SWITCH, LOSS = "identity switch", "lost track"
KINDS = (SWITCH, LOSS)


@dataclass(frozen=True)
class TrackFailure:
    """One failure of a tracker, ``identity switch`` or ``lost track``, by one of ``CAUSES``.

    ``before`` and ``after`` are the tracks that the vehicle had and has, by the tracker's own number, -1 if none;
    ``time_s`` is that of the first match to the new one, or that at which the old one was gone.
    """

    kind: str
    cause: str
    vehicle_id: str
    time_s: float
    before: int
    after: int


def failures(evidence: Evidence) -> list[TrackFailure]:
    """Return all identity switches in sight and all lost tracks of hidden vehicles, in the order of time.

    The switches are those that ``mot.id_switches`` counts. A track is lost once for each time that its vehicle is
    hidden and the track that held it is no longer reported.
    """
    tracks = _Tracks(evidence)
    found = [*_switches(evidence, tracks), *_losses(evidence, tracks)]
    return sorted(found, key=lambda failure: (failure.time_s, failure.kind, failure.vehicle_id))


def counted(found: Sequence[TrackFailure]) -> dict[str, dict[str, int]]:
    """Return the number of failures by kind and cause, zeros too."""
    return {
        kind: {cause: sum((each.kind, each.cause) == (kind, cause) for each in found) for cause in CAUSES}
        for kind in KINDS
    }


class _Tracks:
    """The reported tracks of a run: when each began and ended; and the vehicles' names."""

    def __init__(self, evidence: Evidence) -> None:
        self.evidence = evidence
        self.rows = evidence.rows.tracks
        kept = scored_rows(evidence.rows, evidence.history)
        codes, first = np.unique(evidence.rows.truth.vehicle[kept], return_index=True)
        names = evidence.error_table["vehicle_id"].astype(str).to_numpy()[first]
        self.name = dict(zip(codes.tolist(), names.tolist(), strict=True))
        count = int(self.rows.track.max(initial=-1)) + 1
        places = np.arange(len(self.rows))
        self.first, self.last = np.full(count, -1), np.full(count, -1)
        # Rows are sorted by step, so what is written last is a track's last row.
        self.first[self.rows.track[::-1]], self.last[self.rows.track] = places[::-1], places

    def end_of(self, track: int, vehicle_row: int) -> str:
        """Return why a track ended: within the gate along its vehicle of another that went on, or not."""
        rows, row = self.rows, int(self.last[track])
        near = np.flatnonzero(rows.step == rows.step[row])
        off_lon, off_lat = rows.lon_m[near] - rows.lon_m[row], rows.lat_m[near] - rows.lat_m[row]
        direction = np.full(len(near), self.evidence.rows.truth.direction_rad[vehicle_row])
        close = similarity(*along_and_across(off_lon, off_lat, direction)) >= GATE_SIMILARITY
        goes_on = rows.step[self.last[rows.track[near]]] > rows.step[row]
        return MERGE if (close & goes_on & (near != row)).any() else DEATH


def _switches(evidence: Evidence, tracks: _Tracks) -> Iterator[TrackFailure]:
    sequence, truth, rows = evidence.in_sight, evidence.rows.truth, evidence.rows.tracks
    chosen = select_in_sight(evidence.rows, evidence.history, evidence.pairs)
    truth_rows, track_rows = np.flatnonzero(chosen.truth), np.flatnonzero(chosen.tracks)
    matches = clear_matches(sequence)
    for place in matches.switches(sequence):
        old_row, new_row = (int(track_rows[matches.track[at]]) for at in (place - 1, place))
        last, now = (int(truth_rows[matches.truth[at]]) for at in (place - 1, place))
        yield TrackFailure(
            SWITCH,
            _cause_of_switch(evidence, tracks, (last, now), (old_row, new_row)),
            tracks.name[int(truth.vehicle[now])],
            float(truth.time_s[now]),
            int(rows.track_id[old_row]),
            int(rows.track_id[new_row]),
        )


def _cause_of_switch(evidence: Evidence, tracks: _Tracks, vehicle: tuple[int, int], track: tuple[int, int]) -> str:
    """Return the cause of a switch, between rows of the last match to the old track and of the first to the new one."""
    truth, rows = evidence.rows.truth, evidence.rows.tracks
    last, now = vehicle
    old, new = (int(rows.track[row]) for row in track)
    there = int(find_track_rows(evidence.rows, truth.step[now : now + 1], np.array([old]))[0])
    if there < 0:
        return tracks.end_of(old, last)
    on = int(evidence.matching.truth_row[there])
    if on >= 0 and truth.vehicle[on] != truth.vehicle[now]:
        return ASSOCIATION
    longest_gap_s = evidence.history.since_s[last : now + 1].max()
    if longest_gap_s > IN_SIGHT_S + TIME_TOLERANCE_S:
        return REIDENTIFICATION
    return BIRTH if rows.step[tracks.first[new]] > truth.step[last] else ASSOCIATION


def _losses(evidence: Evidence, tracks: _Tracks) -> Iterator[TrackFailure]:
    rows, truth = evidence.rows, evidence.rows.truth
    kept = scored_rows(rows, evidence.history)
    lost = np.zeros(len(truth), dtype=bool)
    lost[kept[(evidence.errors.outcome == LOST) & (evidence.errors.state == HIDDEN)]] = True
    for begin in _beginnings(lost, truth.vehicle, evidence.matching.holder):
        holder = int(evidence.matching.holder[begin])
        yield TrackFailure(
            LOSS,
            tracks.end_of(holder, begin),
            tracks.name[int(truth.vehicle[begin])],
            float(truth.time_s[begin]),
            int(rows.tracks.track_id[tracks.last[holder]]),
            -1,
        )


def _beginnings(lost: np.ndarray, vehicle: IntArray, holder: IntArray) -> IntArray:
    """Return the first row of each time that a vehicle's track is lost; another holder is another loss."""
    where = np.flatnonzero(lost)
    first = np.ones(len(where), dtype=bool)
    first[1:] = (vehicle[where[1:]] != vehicle[where[:-1]]) | (holder[where[1:]] != holder[where[:-1]])
    return where[first]


@dataclass(frozen=True)
class Why:
    """What the failures of both runs come from, and the folders where their replays lie."""

    a: tuple[TrackFailure, ...]
    b: tuple[TrackFailure, ...]
    folder_a: str
    folder_b: str

    def counts(self) -> dict[str, dict[str, dict[str, int]]]:
        """Return the number of failures by run, kind and cause."""
        return {"a": counted(self.a), "b": counted(self.b)}


def moment_of(failure: TrackFailure) -> str:
    """Return what the address of a replay ends in where it shows the failure, from a second before it."""
    vehicle = quote(failure.vehicle_id, safe="")
    return f"#t={max(0.0, failure.time_s - 1.0):.1f}&vehicle={vehicle}"
