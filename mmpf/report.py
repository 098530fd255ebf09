"""What the filter tells the outside of its components: one track each."""

from __future__ import annotations

import numpy as np

from mmpf.moments import Moments
from mmpf.options import ReportingOptions
from mmpf.state import ACCEL, CONFIRMED, HIDDEN, LAT, LAT_SPEED, LON, SPEED, TENTATIVE, Mixture, Tracks


def reported_tracks(mixture: Mixture, moments: Moments, options: ReportingOptions) -> Tracks:
    """Return mean and spread of each component as a track.

    Args:
        mixture: The belief.
        moments: Its components' moments.
        options: When a component counts as hidden, and how widely spread a hidden one may be to be reported.
    """
    components = mixture.components
    unseen = components.unseen_s > options.hidden_after_s
    reported = ~unseen | (moments.std[LON] <= options.reported_std_lon_m)
    state = np.where(components.confirmed, np.where(unseen, HIDDEN, CONFIRMED), TENTATIVE)
    std = np.maximum(moments.std, 1e-6)
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
        existence=components.existence[reported],
        state=state[reported].astype(np.int8),
    )
