"""Whether a vehicle that turned while hidden is reported on the route that it took.

At a junction a hidden vehicle may leave by one of several ways, and a tracker has to believe in one. The vehicle's own
record tells which was right: no map is needed, and no way is right that merely lies nearest.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from harness.scoring.evidence.matching import find_track_rows
from harness.scoring.evidence.rows import RunRows, TruthRows
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M, TIME_TOLERANCE_S
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.manoeuvre import LEFT, RIGHT, ROUNDABOUT, manoeuvre_between, manoeuvres
from harness.scoring.metrics.parts import of_whole, ratio
from harness.scoring.metrics.quantity import Quantity
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

NAME = "unseen_turns"
UNSEEN_S = 2.0
"""Turns of vehicles that go undetected for at least this long count."""
ON_ROUTE_M = 3.0
"""A track that is farther from the way that the vehicle drove is on another way: the next lane begins there."""
BEFORE_S, AFTER_S = 5.0, 5.0
"""How much of the vehicle's record around the time without detection is its way."""

QUANTITIES = (
    Quantity(f"{NAME}.right_route_percent", "right route after an unseen turn, %", True, weight=f"{NAME}.events"),
    Quantity(f"{NAME}.foreseen_percent", "right route just before it came back, %", True, weight=f"{NAME}.events"),
)  # fmt: skip


@dataclass(frozen=True)
class TurnsPart:
    """Unseen turns, and those with the old track on the right route at the re-detection and a step before."""

    events: int
    right: int
    foreseen: int


def measure_turns(evidence: Evidence) -> TurnsPart | None:
    """Count in a stretch; None on a road with a frame of its own."""
    rows, events = evidence.rows, evidence.events
    manoeuvre = manoeuvres(rows)
    if manoeuvre is None:
        return None
    code = manoeuvre_between(manoeuvre, events.onset_row, events.return_row)
    turned = np.isin(code, (LEFT, RIGHT, ROUNDABOUT)) & (events.duration_s >= UNSEEN_S - TIME_TOLERANCE_S)
    onset, back = events.onset_row[turned], events.return_row[turned]
    holder = evidence.matching.holder[onset]
    return TurnsPart(
        events=len(onset),
        right=int(on_right_route(rows, onset, back, back, holder).sum()),
        foreseen=int(on_right_route(rows, onset, back, back - 1, holder).sum()),
    )


def on_right_route(rows: RunRows, onset: IntArray, back: IntArray, judged: IntArray, track: IntArray) -> BoolArray:
    """Return which vehicles a track follows on the way that they drive, shape (e,).

    Args:
        rows: The run.
        onset: Row of each vehicle's last detection, shape (e,).
        back: Row of its re-detection, shape (e,).
        judged: Row at which it is judged, shape (e,).
        track: Code of its track, -1 if it has none, shape (e,).
    """
    truth, tracks = rows.truth, rows.tracks
    place = find_track_rows(rows, truth.step[judged], track)
    right = np.zeros(len(onset), dtype=np.bool_)
    for event in np.flatnonzero((place >= 0) & (track >= 0)):
        at = shapely.Point(tracks.lon_m[place[event]], tracks.lat_m[place[event]])
        row = judged[event]
        away_m = np.hypot(at.x - truth.lon_m[row], at.y - truth.lat_m[row])
        way = shapely.LineString(_way(truth, int(onset[event]), int(back[event])))
        right[event] = away_m < FOLLOW_CUTOFF_M and at.distance(way) <= ON_ROUTE_M
    return right


def _way(truth: TruthRows, onset: int, back: int) -> FloatArray:
    """Return the places that a vehicle went past around two of its rows, both ends drawn out, shape (k, 2)."""
    same = np.flatnonzero(truth.vehicle == truth.vehicle[onset])
    time_s = truth.time_s[same]
    inside = (time_s >= truth.time_s[onset] - BEFORE_S) & (time_s <= truth.time_s[back] + AFTER_S)
    kept = same[inside]
    line = np.stack([truth.lon_m[kept], truth.lat_m[kept]], axis=-1)
    ends = truth.direction_rad[kept[[0, -1]]]
    reach = FOLLOW_CUTOFF_M * np.stack([np.cos(ends), np.sin(ends)], axis=-1)
    return np.concatenate([line[:1] - reach[:1], line, line[-1:] + reach[1:]])


@of_whole
def scores_of_turns(part: TurnsPart) -> dict[str, object]:
    """Return how often the right route is reported.

    Returns:
        Of ``events``, occlusions of at least 2 s in which a vehicle turns or is on a roundabout:
        ``right_route_percent``, those in which the track that held it is reported, at the moment of its re-detection,
        within 10 m of it and within 3 m of the way that it drove; ``foreseen_percent``, the same a step earlier, before
        the detection could tell. Empty on a road with a frame of its own.
    """
    return {
        "right_route_percent": ratio(100.0 * part.right, part.events),
        "foreseen_percent": ratio(100.0 * part.foreseen, part.events),
        "events": part.events,
    }
