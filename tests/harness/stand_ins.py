"""A small world for tests of the loop: cars at constant speed, the real sensor, and a tracker without memory."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from harness.config.model import RunConfig
from harness.running.follow import StageTimes, follow
from harness.running.open import OpenSnapshots
from harness.running.recorder import ColumnRecorder
from harness.running.snapshots import RandomStreams, SnapshotStream, observe_traffic
from harness.sensor.detector import build_sensor
from harness.sensor.profiles import sensor_settings
from harness.trackers.protocol import TrackerSetting
from harness.truth.frame import Frame
from mmpf.map.corridor_road import highway
from mmpf.map.road import Road
from mmpf.scan import Scan
from mmpf.tracks import Tracks
from tests.harness.closedloop.frames import frame_of
from tests.mmpf.scenes import tracks_of


def track(snapshots, build, seed, watchers=(), times=None) -> SimpleNamespace:
    """Follow snapshots to their end and return what a run of this root seed records."""
    recorder = ColumnRecorder()
    follow(snapshots, build, recorder, RandomStreams.from_seed(seed).tracker, watchers, times or StageTimes())
    return SimpleNamespace(**{name.removesuffix(".parquet"): table for name, table in recorder.tables().items()})


@dataclass
class SteadyTraffic:
    """Cars in a queue on three lanes, each at its lane's speed; a new ego after every ``ego_stay`` frames."""

    steps: int = 20
    ego_stay: int = 10_000
    cars_per_lane: int = 6
    fail_at: int | None = None
    road: Road = field(default_factory=lambda: highway(3))
    step_s: float = 0.1
    closed: bool = False

    @property
    def expected_steps(self) -> int:
        return self.steps

    def frames(self) -> Iterator[Frame]:
        lane = np.repeat([3, 2, 1], self.cars_per_lane)
        start = np.tile(20.0 * np.arange(self.cars_per_lane), 3)
        speed = 20.0 + 2.0 * (3 - lane)
        count = len(lane)
        for step in range(self.steps):
            if step == self.fail_at:
                raise RuntimeError("the traffic broke")
            names, lon_m = [f"car{k}" for k in range(count)], start + speed * step * self.step_s
            frame = frame_of(lon_m, (3 - lane + 0.5) * 3.66, speed, step, names, lane=lane)
            stay = step // self.ego_stay
            yield replace(frame, time_s=round(step * self.step_s, 1), episode=stay, ego=stay % count)

    def close(self) -> None:
        self.closed = True


def observing(traffic: SteadyTraffic) -> OpenSnapshots:
    """Return what opens this traffic, seen by the configuration's sensor, in the place of what is asked for."""

    def open_snapshots(config: RunConfig) -> SnapshotStream:
        sensor = build_sensor(sensor_settings(config.sensor.profile, config.sensor.overrides))
        return observe_traffic(traffic, sensor, config.seed)

    return open_snapshots


@dataclass
class EchoTracker:
    """Reports every detection as a new track with a little noise of its own; ids start at 0 in each episode."""

    setting: TrackerSetting
    next_id: int = 0

    def step(self, scan: Scan) -> Tracks:
        count = len(scan.detections)
        ids = np.arange(self.next_id, self.next_id + count)
        self.next_id += count
        lon_m = scan.detections.lon_m + 0.01 * self.setting.rng.standard_normal(count)
        return tracks_of(lon_m, scan.detections.lat_m, track_id=ids, std_lat_m=0.2, std_speed_mps=1.0)


def echo_tracker(setting: TrackerSetting, options: Mapping[str, object]) -> EchoTracker:
    """Build one; takes no options that mean anything."""
    return EchoTracker(setting)


def plain_tracker(setting: TrackerSetting, options: Mapping[str, object]) -> EchoTracker:
    """Build one; refuses options, as trackers of others are asked to."""
    if options:
        raise ValueError(f"no such option: {', '.join(sorted(options))}; it takes none")
    return EchoTracker(setting)


class HeraldTracker(EchoTracker):
    """Leaves a file in the working folder once it is well under way."""

    def step(self, scan: Scan) -> Tracks:
        if scan.time_s > 1.0:
            Path("under-way").touch()
        return super().step(scan)


def herald_tracker(setting: TrackerSetting, options: Mapping[str, object]) -> HeraldTracker:
    """Build one; takes no options that mean anything."""
    return HeraldTracker(setting)
