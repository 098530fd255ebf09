"""A tracker, a motion model, a driver, a sensor, a reader of recorded traffic and an export of another package."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from harness.plugins import Belief, Command, ReadTraffic, RecordedRun, Rows, SensorSettings, TrackerSetting
from mmpf import Scan, Surroundings, Tracks, highway


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
        self, state: np.ndarray, latents: np.ndarray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        return state.copy(), latents


class Sunday:
    """A driver that never speeds up and never changes lanes."""

    def command(self, belief: Belief) -> Command:
        never = np.zeros(len(belief), dtype=bool)
        return Command(np.zeros(len(belief)), never, never)


def far_sighted() -> SensorSettings:
    """Return a sensor that sees 250 m far."""
    return SensorSettings(range_m=250.0)


def read_queue(path: Path) -> ReadTraffic:
    """Read a file of bytes: for each, a car that starts so many metres up a straight road and drives at 20 m/s."""
    start = np.frombuffer(path.read_bytes(), dtype=np.uint8).astype(np.float64)
    time_s = 0.1 * np.arange(31)
    count = len(start) * len(time_s)
    return ReadTraffic(
        road=highway(),
        names=np.array([f"car{k}" for k in range(len(start))]),
        rows=Rows(
            vehicle=np.repeat(np.arange(len(start)), len(time_s)),
            time_s=np.tile(time_s, len(start)),
            lon_m=np.repeat(start, len(time_s)) + 20.0 * np.tile(time_s, len(start)),
            lat_m=np.full(count, 5.5),
            heading_rad=np.zeros(count),
            speed_mps=np.full(count, 20.0),
            lat_speed_mps=np.zeros(count),
            length_m=np.full(count, 4.5),
            width_m=np.full(count, 1.8),
        ),
        vehicles_read=len(start),
    )


def write_speeds(run: RecordedRun, folder: Path) -> list[Path]:
    """Write the mean speed of each vehicle."""
    path = folder / "speeds.txt"
    means = run.truth.groupby("vehicle_id")["speed_mps"].mean()
    path.write_text("".join(f"{name} {speed:.2f}\n" for name, speed in means.items()))
    return [path]
