"""A reference: Kalman filters that are told which vehicle each detection came from.

They never mix vehicles up. They are no bound on errors: while a vehicle is hidden they only coast.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from harness.trackers.plane import along_their_motion, is_in_plane, without_directions
from harness.trackers.protocol import TrackerSetting, trackers
from mmpf.compute.arrays import FloatArray, IntArray, StringArray, joined, taken
from mmpf.scan import Detections, EgoPose, Scan, check_scan
from mmpf.settings import Positive, Settings, in_unit
from mmpf.tracks import CONFIRMED, HIDDEN, TENTATIVE, Tracks


class OracleOptions(Settings):
    """Settings of the oracle."""

    lon_noise: Annotated[Positive, in_unit("m²/s³")] = 1.0
    """Power spectral density of the longitudinal acceleration."""
    lat_noise: Annotated[Positive, in_unit("m²/s³")] = 0.1
    """Power spectral density of the lateral acceleration."""
    confirm_detections: Annotated[int, Field(ge=1)] = 3
    """Detections before a track is confirmed."""
    hidden_after_s: Positive = 0.5
    """Unseen for longer, a track is reported as hidden, which is for pictures alone."""
    longest_unseen_s: Positive = 10.0
    """Unseen for longer, a track ends; the vehicle returns under a new identity."""
    birth_speed_std_mps: Positive = 10.0
    """Spread of a new track's speed around the ego's, where speed is not measured."""
    birth_lat_speed_std_mps: Positive = 1.0
    """Spread of a new track's lateral speed."""


@dataclass(frozen=True)
class _Followed:
    """The vehicles that are being followed, struct of arrays over n vehicles."""

    truth_id: StringArray
    track_id: IntArray
    states: GaussianStates
    last_seen_s: FloatArray
    detections: IntArray


class OracleKalman:
    """One constant-velocity Kalman filter for each vehicle, with the true association of every detection."""

    def __init__(self, options: OracleOptions, in_plane: bool = False) -> None:
        if in_plane:
            alike = {"lat_noise": options.lon_noise, "birth_lat_speed_std_mps": options.birth_speed_std_mps}
            options = options.model_copy(update=alike)
        self._options, self._in_plane = options, in_plane
        self._time_s: float | None = None
        self._next_track_id = 1
        no_index, no_states = np.zeros(0, dtype=np.int64), GaussianStates(np.zeros((0, 4)), np.zeros((0, 4, 4)))
        self._followed = _Followed(np.zeros(0, dtype=np.str_), no_index, no_states, np.zeros(0), no_index)

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
        self._followed = taken(followed, time_s - followed.last_seen_s <= options.longest_unseen_s)

    def _update(self, scan: Scan, truth_id: StringArray, detection: IntArray) -> None:
        known = np.isin(truth_id[detection], self._followed.truth_id)
        self._begin(scan, truth_id, detection[~known])
        seen = detection[known]
        position = {name: index for index, name in enumerate(self._followed.truth_id.tolist())}
        index = np.array([position[name] for name in truth_id[seen].tolist()], dtype=np.int64)
        followed = self._followed
        last_seen_s, detections = followed.last_seen_s.copy(), followed.detections.copy()
        last_seen_s[index] = scan.time_s
        detections[index] += 1
        states = _update_states(followed.states, index, scan.detections, seen)
        self._followed = replace(followed, states=states, last_seen_s=last_seen_s, detections=detections)

    def _begin(self, scan: Scan, truth_id: StringArray, detection: IntArray) -> None:
        count = len(detection)
        if not count:
            return
        begun = _Followed(
            truth_id[detection],
            self._next_track_id + np.arange(count),
            _newborn_states(scan.detections, detection, scan.ego, self._options),
            np.full(count, scan.time_s),
            np.ones(count, dtype=np.int64),
        )
        self._followed = joined(self._followed, begun)
        self._next_track_id += count

    def _tracks(self, time_s: float) -> Tracks:
        followed, options = self._followed, self._options
        mean, std = followed.states.mean, followed.states.std
        confirmed = followed.detections >= options.confirm_detections
        hidden = confirmed & (time_s - followed.last_seen_s > options.hidden_after_s)
        return Tracks(
            track_id=followed.track_id,
            lon_m=mean[:, LON],
            lat_m=mean[:, LAT],
            speed_mps=mean[:, SPEED],
            lat_speed_mps=mean[:, LAT_SPEED],
            accel_mps2=np.zeros(len(mean)),
            std_lon_m=std[:, LON],
            std_lat_m=std[:, LAT],
            std_speed_mps=std[:, SPEED],
            existence=np.ones(len(mean)),
            state=np.select([hidden, confirmed], [HIDDEN, CONFIRMED], TENTATIVE).astype(np.int8),
        )


@trackers.register("oracle-kalman")
def build_oracle_kalman(setting: TrackerSetting, options: Mapping[str, object]) -> OracleKalman:
    """Build the oracle; it needs no more of the setting than whether the road frame is the plane."""
    return OracleKalman(OracleOptions.model_validate(dict(options)), is_in_plane(setting))


def _rounds_without_repetition(truth_id: StringArray) -> list[IntArray]:
    """Split the detections into rounds in which no vehicle occurs twice, clutter left out."""
    rounds: list[list[int]] = []
    occurrences: dict[str, int] = {}
    for detection, name in enumerate(truth_id.tolist()):
        if name:
            nth = occurrences.get(name, 0)
            occurrences[name] = nth + 1
            if nth == len(rounds):
                rounds.append([])
            rounds[nth].append(detection)
    return [np.array(members, dtype=np.int64) for members in rounds]


def _update_states(
    states: GaussianStates, index: IntArray, detections: Detections, detection: IntArray
) -> GaussianStates:
    states = update_variable(states, index, LON, detections.lon_m[detection], detections.std_lon_m[detection])
    states = update_variable(states, index, LAT, detections.lat_m[detection], detections.std_lat_m[detection])
    has_speed = np.isfinite(detections.speed_mps[detection])
    measured, std = detections.speed_mps[detection], detections.std_speed_mps[detection]
    return update_variable(states, index[has_speed], SPEED, measured[has_speed], std[has_speed])


def _newborn_states(
    detections: Detections, detection: IntArray, ego: EgoPose, options: OracleOptions
) -> GaussianStates:
    count = len(detection)
    has_speed = np.isfinite(detections.speed_mps[detection])
    speed = np.where(has_speed, detections.speed_mps[detection], ego.speed_mps)
    std_speed = np.where(has_speed, detections.std_speed_mps[detection], options.birth_speed_std_mps)
    std_lat_speed = np.full(count, options.birth_lat_speed_std_mps)
    mean = np.column_stack([detections.lon_m[detection], speed, detections.lat_m[detection], np.zeros(count)])
    std = np.column_stack([detections.std_lon_m[detection], std_speed, detections.std_lat_m[detection], std_lat_speed])
    return GaussianStates(mean, std[:, :, None] ** 2 * np.eye(4))


LON, SPEED, LAT, LAT_SPEED = range(4)


@dataclass(frozen=True)
class GaussianStates:
    """Gaussian beliefs of n vehicles.

    Attributes:
        mean: Longitudinal position and speed, lateral position and speed, shape (n, 4).
        covariance: Shape (n, 4, 4).
    """

    mean: FloatArray
    covariance: FloatArray

    @property
    def std(self) -> FloatArray:
        """Standard deviation of each state variable, shape (n, 4)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def predict_constant_velocity(
    states: GaussianStates, interval_s: float, lon_noise: float, lat_noise: float
) -> GaussianStates:
    """Predict by the nearly-constant-velocity model (Bar-Shalom, Li, Kirubarajan 2001, section 6.2.2).

    Args:
        states: Beliefs before.
        interval_s: Time to predict over.
        lon_noise: Power spectral density of the longitudinal acceleration, m^2/s^3.
        lat_noise: The same laterally.
    """
    transition = np.eye(4)
    transition[LON, SPEED] = transition[LAT, LAT_SPEED] = interval_s
    unit_noise = np.array([[interval_s**3 / 3, interval_s**2 / 2], [interval_s**2 / 2, interval_s]])
    noise = np.zeros((4, 4))
    noise[:2, :2] = lon_noise * unit_noise
    noise[2:, 2:] = lat_noise * unit_noise
    return GaussianStates(states.mean @ transition.T, transition @ states.covariance @ transition.T + noise)


def update_variable(
    states: GaussianStates, index: IntArray, variable: int, measured: FloatArray, std: FloatArray
) -> GaussianStates:
    """Update some vehicles by a direct measurement of one state variable.

    Measurements with independent errors may be taken in one after the other, so no matrix is inverted.

    Args:
        states: Beliefs before.
        index: Which vehicles are measured, each at most once, shape (k,).
        variable: ``LON``, ``SPEED``, ``LAT`` or ``LAT_SPEED``.
        measured: Measured values, shape (k,).
        std: Standard deviations of their errors, shape (k,).
    """
    prior = taken(states, index)
    cross = prior.covariance[:, :, variable]
    gain = cross / (cross[:, variable] + std**2)[:, None]
    mean, covariance = states.mean.copy(), states.covariance.copy()
    mean[index] = prior.mean + gain * (measured - prior.mean[:, variable])[:, None]
    posterior = prior.covariance - gain[:, :, None] * cross[:, None, :]
    covariance[index] = 0.5 * (posterior + posterior.transpose(0, 2, 1))
    return replace(states, mean=mean, covariance=covariance)
