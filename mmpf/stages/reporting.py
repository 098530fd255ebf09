"""What the filter tells after a scan: the tracks, and what happened inside the step."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments
from mmpf.motion.state import ACCEL, LAT, LAT_SPEED, LON, SPEED
from mmpf.options.filter import ReportingOptions
from mmpf.tracks import CONFIRMED, HIDDEN, TENTATIVE, Tracks


def reported_tracks(
    mixture: Mixture, moments: Moments, options: ReportingOptions, correlated_share: float = 0.0
) -> Tracks:
    """Return mean and spread of each component as a track, but for hidden ones that are spread too widely.

    What drifts of the sensor's noise can't be told from the vehicle's place: it is added to the spread.

    Args:
        mixture: The belief.
        moments: Its components' moments.
        options: When a component is hidden, and which of those are reported.
        correlated_share: Share of the noise's variance that drifts.
    """
    components = mixture.components
    unseen = components.unseen_s > options.hidden_after_s
    reported = ~unseen | (moments.std_along_m <= options.reported_std_lon_m)
    reported &= ~unseen | (components.vehicle >= options.reported_hidden_above)
    state = np.where(components.confirmed, np.where(unseen, HIDDEN, CONFIRMED), TENTATIVE)
    variance = moments.variance.copy()
    noise_lon_m, noise_lat_m = components.noise_m
    variance[LON] += correlated_share * noise_lon_m**2
    variance[LAT] += correlated_share * noise_lat_m**2
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
