"""A sample of a particle filter's particles at every step, for the replay."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from harness.cosim import AnyTracker
from harness.moment import ParticleFilter
from harness.sensor.observation import Observation
from harness.truth.frame import Frame
from mmpf.road import IntArray
from mmpf.state import LAT, LON, ParticleCloud, Tracks

SHOWN_PER_COMPONENT = 12
DECIMALS = 2


@dataclass
class ParticleKeeper:
    """Collects a few particles of every component at every step, of trackers that have particles."""

    _steps: list[pd.DataFrame] = field(default_factory=list)

    def watch(self, frame: Frame, observation: Observation, tracks: Tracks, tracker: AnyTracker) -> None:  # noqa: ARG002
        """Look at one step."""
        if not isinstance(tracker, ParticleFilter):
            return
        cloud = tracker.mixture.cloud
        lon_lat = cloud.state[[LON, LAT]][:, systematic_sample(cloud, SHOWN_PER_COMPONENT)]
        lon_m, lat_m = np.round(lon_lat, DECIMALS).astype(np.float32)
        self._steps.append(pd.DataFrame({"step": np.full(len(lon_m), frame.step), "lon_m": lon_m, "lat_m": lat_m}))

    def table(self) -> pd.DataFrame | None:
        """Return columns step, lon_m, lat_m; None without any particle."""
        return pd.concat(self._steps, ignore_index=True) if self._steps else None


def systematic_sample(cloud: ParticleCloud, per_component: int) -> IntArray:
    """Return indices of particles that stand for their component: heavy ones often, and nothing left to chance.

    Evenly spaced positions on the running sum of the weights (Kitagawa 1996), which grows by one with each component.
    """
    if not len(cloud):
        return np.zeros(0, dtype=np.int64)
    components = int(cloud.component[-1]) + 1
    positions = (np.arange(components * per_component) + 0.5) / per_component
    index = np.searchsorted(np.cumsum(np.exp(cloud.log_weight)), positions)
    return np.minimum(index, len(cloud) - 1)
