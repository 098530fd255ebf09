"""Conversions between this project and Stone Soup: detections, tracks, initiation and the order of steps.

Stone Soup keeps tracks and detections in Python sets, whose order follows memory addresses. That would make two equal
runs differ, so everything here is kept in ordered sets.
"""

import math
from collections.abc import Iterable
from datetime import datetime, timedelta

import numpy as np
from ordered_set import OrderedSet
from stonesoup.base import Property
from stonesoup.deleter.base import Deleter
from stonesoup.hypothesiser.base import Hypothesiser
from stonesoup.initiator.simple import MultiMeasurementInitiator, SimpleMeasurementInitiator
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.types.detection import Detection
from stonesoup.types.multihypothesis import MultipleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.types.update import Update

from harness.trackers.kalman import LAT, LON, SPEED
from mmpf.scan import Detections

STATE_SIZE = 4
_NOISE_STEP = 1.1
_MEASURED = "measured values with their standard deviations"
_EPOCH = datetime(2000, 1, 1)


def to_datetime(time_s: float) -> datetime:
    """Return the moment that stands for a scan's time; Stone Soup counts in dates."""
    return _EPOCH + timedelta(seconds=time_s)


def to_seconds(moment: datetime) -> float:
    """Return the scan time of a moment."""
    return (moment - _EPOCH).total_seconds()


class DetectionMaker:
    """Turns our detections into Stone Soup's, each with its own measurement noise.

    Noise is rounded to a scale of steps of a tenth, and detections of equal noise share one measurement model, so that
    Stone Soup predicts one measurement for all of them: deviations off by at most 5 % for half the time. Correlations
    are rounded to tenths.
    """

    def __init__(self) -> None:
        self._models: dict[tuple[tuple[float, ...], float], LinearGaussian] = {}

    def make(self, detections: Detections, moment: datetime) -> OrderedSet[Detection]:
        """Return the detections in their order.

        The speed counts if every detection of the scan has it: likelihoods of different dimension can't be compared.
        """
        with_speed = bool(np.isfinite(detections.speed_mps).all())
        return OrderedSet(self._detection(detections, k, with_speed, moment) for k in range(len(detections)))

    def _detection(self, detections: Detections, k: int, with_speed: bool, moment: datetime) -> Detection:
        values = [detections.lon_m[k], detections.lat_m[k]]
        stds = [float(detections.std_lon_m[k]), float(detections.std_lat_m[k])]
        if with_speed:
            values.append(detections.speed_mps[k])
            stds.append(float(detections.std_speed_mps[k]))
        return Detection(
            np.array(values)[:, None],
            timestamp=moment,
            measurement_model=self._model(
                tuple(_NOISE_STEP ** round(math.log(std, _NOISE_STEP)) for std in stds), _tenths(detections, k)
            ),
            metadata={_MEASURED: tuple(zip(map(float, values), stds, strict=True))},
        )

    def _model(self, stds: tuple[float, ...], correlation: float) -> LinearGaussian:
        key = stds, correlation
        if key not in self._models:
            if len(self._models) > 1000:
                self._models.clear()
            covariance = np.diag(np.square(stds))
            covariance[0, 1] = covariance[1, 0] = correlation * stds[0] * stds[1]
            self._models[key] = LinearGaussian(
                ndim_state=STATE_SIZE,
                mapping=(LON, LAT, SPEED)[: len(stds)],
                noise_covar=covariance,
            )
        return self._models[key]


def _tenths(detections: Detections, k: int) -> float:
    """Return the correlation of a position's noises, rounded to tenths, and away from one."""
    if detections.correlation is None:
        return 0.0
    return float(np.clip(round(10.0 * detections.correlation[k]) / 10.0, -0.9, 0.9))


class WithinReach(Hypothesiser):
    """Shows the hypothesiser inside only those detections that are near a track's place, however uncertain it is."""

    hypothesiser: Hypothesiser = Property(doc="What makes the hypotheses.")
    reach_m: tuple[float, float] = Property(doc="Largest distance along the road and across it.")

    def hypothesise(
        self, track: Track, detections: Iterable[Detection], timestamp: datetime, **kwargs: object
    ) -> MultipleHypothesis:
        """Return the hypotheses of one track."""
        prediction = self.hypothesiser.predictor.predict(track, timestamp=timestamp)
        mean = np.asarray(prediction.mean, dtype=float).ravel()
        place = [(float(mean[row]), reach) for row, reach in zip((LON, LAT), self.reach_m, strict=True)]
        near = OrderedSet(
            detection
            for detection in detections
            if all(
                abs(value - centre) <= reach
                for (value, _), (centre, reach) in zip(detection.metadata[_MEASURED], place, strict=False)
            )
        )
        return self.hypothesiser.hypothesise(track, near, timestamp, **kwargs)


class NumberedInitiator(SimpleMeasurementInitiator):
    """Starts a track at each detection, in order, numbered from one."""

    def __init__(self, *args: object, **kwargs: object) -> None:
        super().__init__(*args, **kwargs)
        self._next_number = 1

    def expect_speed(self, speed_mps: float) -> None:
        """Set the mean speed of new tracks whose speed is not measured."""
        prior: GaussianState = self.prior_state
        mean = prior.state_vector.copy()
        mean[SPEED] = speed_mps
        self.prior_state: GaussianState = GaussianState(mean, prior.covar)

    def initiate(self, detections: Iterable[Detection], timestamp: datetime, **kwargs: object) -> OrderedSet[Track]:
        """Return the new tracks."""
        started: OrderedSet[Track] = OrderedSet()
        for detection in _in_order(detections):
            for track in super().initiate({detection}, timestamp, **kwargs):
                track.id = self._next_number
                self._next_number += 1
                started.add(track)
        return started


class OrderedMultiMeasurementInitiator(MultiMeasurementInitiator):
    """Stone Soup's multi-measurement initiator with its tracks and detections in a fixed order."""

    def __init__(self, *args: object, **kwargs: object) -> None:
        super().__init__(*args, **kwargs)
        self.holding_tracks: OrderedSet[Track] = OrderedSet()

    def initiate(self, detections: Iterable[Detection], timestamp: datetime, **kwargs: object) -> OrderedSet[Track]:
        """Return the tracks that now have enough detections, oldest first."""
        confirmed = super().initiate(OrderedSet(_in_order(detections)), timestamp, **kwargs)
        return OrderedSet(sorted(confirmed, key=lambda track: track.id))


class BeyondRangeDeleter(Deleter):
    """Deletes tracks that have left the sensor's range."""

    limit_m: float = Property(doc="Distance from the ego beyond which a track ends.")
    ego_lon_m: float = Property(default=0.0, doc="Where the ego is now.")
    ego_lat_m: float = Property(default=0.0, doc="Where the ego is now.")

    def check_for_deletion(self, track: Track, **_: object) -> bool:
        """Return whether the track's mean lies beyond the limit."""
        mean = np.asarray(track.state.mean).ravel()
        distance = np.hypot(mean[LON] - self.ego_lon_m, mean[LAT] - self.ego_lat_m)
        return bool(distance > self.limit_m)


def forget_before_last_update(track: Track) -> None:
    """Drop the states before a track's last update, which nothing uses, so that memory stays bounded."""
    for index in range(len(track.states) - 1, 0, -1):
        if isinstance(track.states[index], Update):
            del track.states[:index]
            del track.metadatas[:index]
            return


def _in_order(detections: Iterable[Detection]) -> list[Detection]:
    return sorted(detections, key=lambda detection: tuple(np.asarray(detection.state_vector, dtype=float).ravel()))
