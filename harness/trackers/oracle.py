"""A reference: Kalman filters that are given the true origin of each detection.

They never mix vehicles up. They are no bound on errors: while a vehicle is hidden they only coast.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from harness.trackers.kalman import GaussianStates, newborn, predict_constant_velocity, tracks_of, updated
from harness.trackers.plane import along_their_motion, is_in_plane, without_directions
from harness.trackers.protocol import TrackerSetting
from harness.trackers.rivals.lives import Lives
from harness.trackers.track_options import KalmanOptions
from mmpf.numerics.arrays import IntArray, StringArray, joined, taken
from mmpf.options.base import Positive
from mmpf.scan import Scan, check_scan
from mmpf.tracks import CONFIRMED, HIDDEN, TENTATIVE, Tracks


class OracleOptions(KalmanOptions):
    """Settings of the oracle."""

    longest_unseen_s: Positive = 10.0
    """A track without detections for longer ends; the vehicle returns under a new identity."""


@dataclass(frozen=True)
class _Followed:
    """The vehicles that are being followed, struct of arrays over n vehicles."""

    truth_id: StringArray
    lives: Lives
    states: GaussianStates


class OracleKalman:
    """One constant-velocity Kalman filter for each vehicle, with the true association of every detection."""

    def __init__(self, options: OracleOptions, in_plane: bool = False) -> None:
        self._options, self._in_plane = options.in_plane() if in_plane else options, in_plane
        self._time_s: float | None = None
        self._next_track_id = 1
        no_states = GaussianStates(np.zeros((0, 4)), np.zeros((0, 4, 4)))
        self._followed = _Followed(np.zeros(0, dtype=np.str_), Lives.begun(1, 0, 0.0), no_states)

    def step_associated(self, scan: Scan, truth_id: StringArray) -> Tracks:
        """Take in one scan with the true origin of each detection, empty for clutter, shape (d,).

        Raises:
            InvalidScanError: See ``mmpf.scan.check_scan``.
        """
        check_scan(scan, self._time_s)
        if self._in_plane:
            scan = without_directions(scan)
        self._predict(scan.time_s)
        self._time_s = scan.time_s
        for detection in _rounds_without_repetition(truth_id):
            self._update(scan, truth_id, detection)
        tracks = self._tracks(scan.time_s)
        return along_their_motion(tracks) if self._in_plane else tracks

    def _predict(self, time_s: float) -> None:
        if self._time_s is None:
            return
        options = self._options
        states = predict_constant_velocity(
            self._followed.states, time_s - self._time_s, options.lon_noise, options.lat_noise
        )
        followed = replace(self._followed, states=states)
        self._followed = taken(followed, time_s - followed.lives.last_seen_s <= options.longest_unseen_s)

    def _update(self, scan: Scan, truth_id: StringArray, detection: IntArray) -> None:
        known = np.isin(truth_id[detection], self._followed.truth_id)
        self._begin(scan, truth_id, detection[~known])
        seen = detection[known]
        position = {name: index for index, name in enumerate(self._followed.truth_id.tolist())}
        index = np.array([position[name] for name in truth_id[seen].tolist()], dtype=np.int64)
        followed = self._followed
        states = updated(followed.states, index, scan.detections, seen)
        self._followed = replace(followed, states=states, lives=followed.lives.seen(index, scan.time_s))

    def _begin(self, scan: Scan, truth_id: StringArray, detection: IntArray) -> None:
        count = len(detection)
        if not count:
            return
        begun = _Followed(
            truth_id[detection],
            Lives.begun(self._next_track_id, count, scan.time_s),
            newborn(scan.detections, detection, scan.ego, self._options),
        )
        self._followed = joined(self._followed, begun)
        self._next_track_id += count

    def _tracks(self, time_s: float) -> Tracks:
        followed, options = self._followed, self._options
        lives = followed.lives
        confirmed = lives.detections >= options.confirm_detections
        hidden = confirmed & (time_s - lives.last_seen_s > options.hidden_after_s)
        state = np.select([hidden, confirmed], [HIDDEN, CONFIRMED], TENTATIVE).astype(np.int8)
        return tracks_of(lives.track_id, followed.states.mean, followed.states.std, state)


def build_oracle_kalman(setting: TrackerSetting, options: Mapping[str, object]) -> OracleKalman:
    """Build the oracle; it needs no more of the setting than whether the road frame is the plane."""
    return OracleKalman(OracleOptions.model_validate(dict(options)), is_in_plane(setting))


def _rounds_without_repetition(truth_id: StringArray) -> list[IntArray]:
    """Split the detections into rounds in which no vehicle occurs twice, clutter left out."""
    names = truth_id.tolist()
    earlier = np.array([names[:k].count(name) if name else -1 for k, name in enumerate(names)], dtype=np.int64)
    return [np.flatnonzero(earlier == nth) for nth in range(int(earlier.max(initial=-1)) + 1)]
