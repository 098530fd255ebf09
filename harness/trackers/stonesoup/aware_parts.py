"""Stone Soup's predictor, hypothesiser and deleter, told what is known of each track beyond its state."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime

from stonesoup.base import Property
from stonesoup.deleter.base import Deleter
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection
from stonesoup.types.multihypothesis import MultipleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction, Prediction
from stonesoup.types.track import Track

from harness.trackers.stonesoup.awareness import Awareness


class CarFollowingPredictor(KalmanPredictor):
    """Predicts a track that is unseen with the acceleration by which its vehicle follows its leader."""

    awareness: Awareness = Property(doc="What is known of each track.")
    speed_row: int = Property(doc="State row of the longitudinal speed.")
    lon_row: int = Property(doc="State row of the longitudinal position.")

    def __init__(self, *args: object, **kwargs: object) -> None:
        super().__init__(*args, **kwargs)
        self._last: dict[int, tuple[GaussianStatePrediction, float, GaussianStatePrediction]] = {}

    def predict(self, prior: Track, timestamp: datetime | None = None, **kwargs: object) -> GaussianStatePrediction:
        """Return the predicted state."""
        coasting = super().predict(prior, timestamp=timestamp, **kwargs)
        known = self.awareness.of.get(prior.id) if isinstance(prior, Track) else None
        if known is None or known.accel_mps2 == 0.0:
            return coasting
        # The same object for the same question: what is computed from a prediction is kept by Stone Soup.
        last = self._last.get(prior.id)
        if last is not None and last[0] is coasting and last[1] == known.accel_mps2:
            return last[2]
        driven = self._driven(coasting, known.accel_mps2, (timestamp - prior.timestamp).total_seconds())
        self._last = {number: kept for number, kept in self._last.items() if number in self.awareness.of}
        self._last[prior.id] = coasting, known.accel_mps2, driven
        return driven

    def _driven(self, coasting: GaussianStatePrediction, accel_mps2: float, dt_s: float) -> GaussianStatePrediction:
        mean = coasting.state_vector.copy()
        before = float(mean[self.speed_row, 0])
        after = max(before + accel_mps2 * dt_s, min(before, 0.0))
        mean[self.speed_row, 0] = after
        mean[self.lon_row, 0] += 0.5 * (after - before) * dt_s
        return Prediction.from_state(coasting, mean, coasting.covar, timestamp=coasting.timestamp, prior=coasting.prior)


class ShadowAwareHypothesiser(PDAHypothesiser):
    """Makes each track's hypotheses with the detection probability that it has where it is."""

    awareness: Awareness = Property(doc="What is known of each track.")

    def hypothesise(
        self, track: Track, detections: Iterable[Detection], timestamp: datetime, **kwargs: object
    ) -> MultipleHypothesis:
        """Return the hypotheses of one track."""
        known = self.awareness.of.get(track.id)
        if known is not None:
            self.prob_detect: float = known.detection_probability
        return super().hypothesise(track, detections, timestamp, **kwargs)


class MissedInViewDeleter(Deleter):
    """Deletes tracks that should have been detected many times since they were."""

    awareness: Awareness = Property(doc="What is known of each track.")
    longest_missed: float = Property(doc="Expected detections without one after which a track ends.")

    def check_for_deletion(self, track: Track, **_: object) -> bool:
        """Return whether too many expected detections are missing."""
        known = self.awareness.of.get(track.id)
        return known is not None and known.missed > self.longest_missed
