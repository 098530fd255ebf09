"""A tracker that reports what it is shown, a motion model in which nothing moves, and a sensor that sees far."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from harness.sensor.profiles import SensorSettings
from harness.trackers.protocol import TrackerSetting
from mmpf import Scan, Surroundings, Tracks


class EchoTracker:
    """Every detection is a track of its own for one step."""

    def __init__(self, setting: TrackerSetting, options: Mapping[str, object]) -> None:
        if options:
            raise ValueError(f"echo has no options, not {', '.join(options)}")
        self.given = 0

    def step(self, scan: Scan) -> Tracks:
        detections = scan.detections
        count = len(detections)
        self.given += count
        zero, one = np.zeros(count), np.ones(count)
        return Tracks(
            track_id=np.arange(self.given - count, self.given, dtype=np.int64),
            lon_m=detections.lon_m,
            lat_m=detections.lat_m,
            speed_mps=detections.speed_mps,
            lat_speed_mps=zero,
            accel_mps2=zero,
            std_lon_m=one,
            std_lat_m=one,
            std_speed_mps=one,
            existence=one,
            state=np.ones(count, dtype=np.int8),
        )


class Standstill:
    """Every vehicle stays where it is."""

    name = "standstill"
    latent_size = 0

    def draw_latents(self, state: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return np.empty((0, state.shape[1]))

    def propagate(
        self,
        state: np.ndarray,
        latents: np.ndarray,
        surroundings: Surroundings,
        dt_s: float,
        rng: np.random.Generator,
    ) -> tuple[np.ndarray, np.ndarray]:
        return state.copy(), latents


def far_sighted() -> SensorSettings:
    """Return a sensor that sees 250 m far."""
    return SensorSettings(range_m=250.0)
