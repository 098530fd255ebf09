"""Which tracks are in sight: decided from the detections alone, never from what a tracker says of itself."""

from __future__ import annotations

import numpy as np

from harness.scoring.history import first_of_group, last_row_where
from harness.scoring.pairs import GATE_SIMILARITY, rows_near, similarity
from harness.scoring.rows import RunRows
from harness.scoring.settings import TIME_TOLERANCE_S, ScoringSettings
from mmpf.compute.arrays import BoolArray


def tracks_in_sight(rows: RunRows, settings: ScoringSettings) -> BoolArray:
    """Return which reported tracks are in sight, shape (m,) along ``TrackRows``.

    A track is out of sight once no detection has lain within the gate of its reported place for more than
    ``in_sight_s``, the time after which a vehicle without detections is out of sight as well. The time counts from the
    last step at which the track had such a detection, or from the first at which it was reported if it never had one.
    Clutter counts like any detection, since no tracker can tell it apart.
    """
    tracks = rows.tracks
    has_detection = _has_detection(rows, settings)
    order = np.lexsort((tracks.step, tracks.track))
    track, time_s = tracks.track[order], rows.time_s[tracks.step[order]]
    since_row = last_row_where(has_detection[order] | first_of_group(track), track)
    in_sight = np.zeros(len(tracks), dtype=bool)
    in_sight[order] = time_s - time_s[since_row] <= settings.in_sight_s + TIME_TOLERANCE_S
    return in_sight


def _has_detection(rows: RunRows, settings: ScoringSettings) -> BoolArray:
    """Return which track rows have a detection of their step within the gate, shape (m,)."""
    tracks, detections = rows.tracks, rows.detections
    detection, track = rows_near(detections, tracks, settings.gate_lon_m)
    alike = similarity(
        detections.lon_m[detection] - tracks.lon_m[track], detections.lat_m[detection] - tracks.lat_m[track], settings
    )
    found = np.zeros(len(tracks), dtype=bool)
    found[track[alike >= GATE_SIMILARITY]] = True
    return found
