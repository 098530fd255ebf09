"""What the filter tells the outside of its components: one track each."""

from __future__ import annotations

import numpy as np

from mmpf.moments import component_moments
from mmpf.state import ACCEL, CONFIRMED, HIDDEN, LAT, LAT_SPEED, LON, SPEED, TENTATIVE, Mixture, Tracks


def reported_tracks(mixture: Mixture, hidden_after_s: float) -> Tracks:
    """Return mean and spread of each component as a track.

    Args:
        mixture: The belief.
        hidden_after_s: A confirmed component unseen for longer is reported as hidden.
    """
    components = mixture.components
    moments = component_moments(mixture)
    unseen = components.unseen_s > hidden_after_s
    state = np.where(components.confirmed, np.where(unseen, HIDDEN, CONFIRMED), TENTATIVE)
    std = np.maximum(moments.std, 1e-6)
    return Tracks(
        track_id=components.track_id.copy(),
        lon_m=moments.mean[LON],
        lat_m=moments.mean[LAT],
        speed_mps=moments.mean[SPEED],
        lat_speed_mps=moments.mean[LAT_SPEED],
        accel_mps2=moments.mean[ACCEL],
        std_lon_m=std[LON],
        std_lat_m=std[LAT],
        std_speed_mps=std[SPEED],
        existence=components.existence.copy(),
        state=state.astype(np.int8),
    )
