"""The filter's output after a scan: tracks, and diagnostics of the step."""

from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments
from mmpf.motion.standing import STANDS_MPS
from mmpf.motion.state import ACCEL, LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import ReportingOptions
from mmpf.scan import SensorModel
from mmpf.tracks import CONFIRMED, HIDDEN, TENTATIVE, Tracks


def reported_tracks(mixture: Mixture, moments: Moments, options: ReportingOptions, sensor: SensorModel) -> Tracks:
    """Return mean and spread of each component as a track, except improbable ones and hidden ones spread too widely.

    What drifts of the sensor's noise can't be told from the vehicle's place, nor its rate from the vehicle's speed:
    both are added to the spread. So is how far the vehicle is if the component follows another source.

    Args:
        mixture: The belief.
        moments: Its components' moments.
        options: When a component is hidden, and which of those are reported.
        sensor: The data sheet, which says how much of the noise drifts, and how fast.
    """
    components = mixture.components
    unseen = components.unseen_s > options.hidden_after_s
    reported = ~unseen | (moments.std_along_m <= options.reported_std_lon_m)
    reported &= ~(components.confirmed & components.improbable)
    reported &= ~unseen | (components.vehicle >= options.reported_hidden_above)
    state = np.where(components.confirmed, np.where(unseen, HIDDEN, CONFIRMED), TENTATIVE)
    variance = moments.variance.copy()
    drift_m2 = sensor.noise_correlated_share * np.stack(components.noise_m) ** 2
    lengthwise = np.stack([np.cos(moments.heading_rad), np.sin(moments.heading_rad)]) ** 2
    place_m2, along_m2 = ((lengthwise * each).sum(axis=0) for each in (variance[[LON, LAT]], drift_m2))
    variance[SPEED] += followed_speed_variance(place_m2, variance[SPEED], along_m2, sensor.noise_correlation_s)
    variance[[LON, LAT]] += drift_m2
    # A vehicle that is slower counts as standing, so its speed is known no better.
    variance[SPEED, moments.mean[SPEED] < STANDS_MPS] += STANDS_MPS**2
    probability, squares = components.elsewhere
    variance[[LON, LAT, SPEED]] += probability * np.maximum(squares - variance[[LON, LAT, SPEED]], 0.0)
    variance[:, unseen] *= options.hidden_variance_factor
    std = np.maximum(np.sqrt(variance), 1e-6)
    return Tracks(
        track_id=components.track_id[reported],
        lon_m=moments.mean[LON, reported],
        lat_m=moments.mean[LAT, reported],
        speed_mps=moments.mean[SPEED, reported],
        lat_speed_mps=moments.mean[LAT_SPEED, reported],
        accel_mps2=moments.mean[ACCEL, reported],
        std_lon_m=std[LON, reported],
        std_lat_m=std[LAT, reported],
        std_speed_mps=std[SPEED, reported],
        existence=components.vehicle[reported],
        state=state[reported].astype(np.int8),
    )


def followed_speed_variance(
    place_m2: FloatArray, speed_m2ps2: FloatArray, drift_m2: FloatArray, correlation_s: float
) -> FloatArray:
    """Return the variance of the speed error that drifting measurement noise causes, (m/s)², shape (n,).

    The filter takes all noise as white, so it takes a drift of the measured place for motion of the vehicle. A steady
    Kalman filter of constant velocity estimates the speed as the measured place passed through the transfer function
    w² s / (s² + √2 w s + w²), with w its deviation of speed over that of place, 1/s. The input here is noise of the
    autocorrelation exp(-t / ``correlation_s``): integral I3 of Newton, Gould and Kaiser (1957, appendix E).

    Args:
        place_m2: The filter's variance of the place, shape (n,).
        speed_m2ps2: Its variance of the speed, shape (n,).
        drift_m2: Variance of the noise that drifts, shape (n,).
        correlation_s: Time constant of the drift, seconds.
    """
    bandwidth = np.sqrt(speed_m2ps2 / np.maximum(place_m2, 1e-12))
    turn = bandwidth * correlation_s
    followed = drift_m2 * bandwidth**2 * turn / (np.sqrt(2.0) * (turn**2 + np.sqrt(2.0) * turn + 1.0))
    return np.asarray(followed)


@dataclass(frozen=True)
class StepReport:
    """What happened inside one step, for diagnostics.

    Attributes:
        components: Components after the step.
        effective_share: Mean effective sample size after weighting, as a share of the particles.
        births: Components added.
        deaths: Components removed.
        merges: Components merged into others.
        reclusterings: Components clustered anew or re-identified.
        association_entropy: Mean entropy of the association, nats.
        stage_ms: Time spent in each stage, milliseconds.
    """

    components: int = 0
    effective_share: float = 1.0
    births: int = 0
    deaths: int = 0
    merges: int = 0
    reclusterings: int = 0
    association_entropy: float = 0.0
    stage_ms: dict[str, float] = field(default_factory=dict)


class Stopwatch:
    """Laps between stages, in milliseconds."""

    def __init__(self) -> None:
        self.laps_ms: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, stage: str) -> None:
        """Note the time since the last lap as the stage's."""
        now = perf_counter()
        self.laps_ms[stage] = 1e3 * (now - self._last)
        self._last = now
