"""The time of a tracker's step against the number of vehicles.

All trackers take in the same scans in turns, so that a busy moment of the machine slows all alike. Vehicles stand in
five lanes at one spacing and drive at one speed; the sensor's range grows with their number. So a larger scene has more
vehicles at the same density, none enters or leaves, and the work per vehicle stays comparable.
"""

import importlib.util
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from time import perf_counter, process_time
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from harness.common.errors import InputError
from harness.running.follow import keep_freed_memory
from harness.running.watchers import report_of
from harness.trackers.catalogue import build_tracker
from harness.trackers.protocol import Tracker, TrackerSetting, TruthAssociatedTracker
from harness.truth.frame import STEP_S
from mmpf.map.corridor_road import highway
from mmpf.registry import UnknownNameError
from mmpf.scan import Detections, EgoPose, Scan, SensorModel
from mmpf.tracks import TENTATIVE

STONE_SOUP = ("stonesoup-gnn", "stonesoup-jpda")
WARM_UP_STEPS, SETTLING_STEPS, SOONEST_STEPS, FEWEST_STEPS = 8, 20, 5, 3
LANES, SPACING_M, JITTER_M, SPEED_MPS = 5, 22.0, 4.0, 15.0
STD_LON_M, STD_LAT_M = 0.3, 0.2


@dataclass(frozen=True)
class BenchPlan:
    """What is measured.

    Attributes:
        budget_s: Processor time that each tracker has for each number of vehicles; a slower one drops out.
    """

    vehicles: tuple[int, ...]
    trackers: tuple[str, ...] = ()
    particles: int = 1000
    steps: int = 40
    seed: int = 0
    budget_s: float = 10.0


@dataclass
class TimedTracker:
    """A tracker on its way through a scene, with the times in ms of its steps so far.

    Attributes:
        model: Name of its motion model, None where it has its own.
        particles: Particles per vehicle, None where there are none.
        ms: Wall times.
        cpu_ms: Processor times.
        stages_ms: Wall times of the tracker's stages.
        tracks: Confirmed tracks after the last scan.
    """

    name: str
    tracker: Tracker
    model: str | None = None
    particles: int | None = None
    ms: list[float] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)
    stages_ms: dict[str, list[float]] = field(default_factory=dict)
    tracks: int = 0

    def step(self, scan: Scan) -> None:
        """Take in a scan and note what it took."""
        cpu_s, wall_s = process_time(), perf_counter()
        tracks = self.tracker.step(scan)
        wall_s, cpu_s = perf_counter() - wall_s, process_time() - cpu_s
        self.ms.append(1e3 * wall_s)
        self.cpu_ms.append(1e3 * cpu_s)
        self.tracks = int((tracks.state != TENTATIVE).sum())
        if (report := report_of(self.tracker)) is not None:
            for stage, took_ms in report.stage_ms.items():
                self.stages_ms.setdefault(stage, []).append(took_ms)

    def row(self, vehicles: int) -> dict[str, Any]:
        """Return its line of the table.

        The first 20 steps, while tracks settle, do not count. Of one whose time was up before, the last three count if
        its tracks stood by then; else the times are None.
        """
        settled = min(SETTLING_STEPS, len(self.ms) - FEWEST_STEPS)
        counted = max(len(self.ms) - settled, 0) if settled >= SOONEST_STEPS else 0

        def percentile(values: Sequence[float], percent: float) -> float | None:
            kept = values[-counted:] if counted else ()
            return float(np.percentile(kept, percent)) if len(kept) else None

        return {
            "tracker": self.name,
            "model": self.model,
            "vehicles": vehicles,
            "particles": self.particles,
            "ms_p50": percentile(self.ms, 50),
            "ms_p95": percentile(self.ms, 95),
            "cpu_ms_p50": percentile(self.cpu_ms, 50),
            "steps": counted,
            "tracks": self.tracks,
            "stages_ms_p50": {stage: percentile(took_ms, 50) for stage, took_ms in self.stages_ms.items()},
        }


def timed_tracker(name: str, particles: int, setting: TrackerSetting) -> TimedTracker:
    """Return the tracker that a name of ``trackers`` stands for.

    Raises:
        InputError: There is no such tracker or model, or it is none that can be timed.
    """
    tracker, _, model = name.partition(":")
    # A colon in another name stands in `module:factory`.
    tracker = tracker if tracker == "mmpf" else name
    options: dict[str, Any] = {"model": model or "residual", "particles": particles} if tracker == "mmpf" else {}
    try:
        built = build_tracker(tracker, setting, options)
    except UnknownNameError as error:
        raise InputError(f"`trackers`: {error}") from None
    if isinstance(built, TruthAssociatedTracker):
        raise InputError(f"`trackers`: {tracker} knows the truth; it is a reference and is not timed")
    return TimedTracker(tracker, built, **options)


def run_bench(plan: BenchPlan, advance: Callable[[], None]) -> list[dict[str, Any]]:
    """Return a row for each number of vehicles and tracker; ``advance`` is called after each scan of each scene."""
    has_stone_soup = importlib.util.find_spec("stonesoup") is not None
    names = plan.trackers or ("mmpf:residual", "mmpf:gmm", "mmpf:cvm", *(STONE_SOUP if has_stone_soup else ()))

    def field_in(vehicles: int, seed: Sequence[int]) -> tuple[list[TimedTracker], Iterator[Scan]]:
        rng = np.random.default_rng(seed)
        sensor, scans = bench_scene(vehicles, plan.steps, rng)
        setting = (highway(LANES), sensor)
        return [
            timed_tracker(name, plan.particles, TrackerSetting(*setting, np.random.default_rng(0), STEP_S))
            for name in names
        ], scans

    keep_freed_memory()
    # Throw-away trackers take a few scans, so that compiling and importing count in no measured step.
    warming, scans = field_in(min(plan.vehicles), [plan.seed])
    for _, scan in zip(range(WARM_UP_STEPS), scans, strict=False):
        for timed in warming:
            timed.tracker.step(scan)
    rows: list[dict[str, Any]] = []
    # As in a run: all trackers' matrix products are small, and one thread is the fastest on a busy machine.
    with threadpool_limits(limits=1, user_api="blas"):
        for vehicles in plan.vehicles:
            contenders, scans = field_in(vehicles, [plan.seed, vehicles])
            time_in_turns(contenders, scans, plan.budget_s, advance)
            rows += [timed.row(vehicles) for timed in contenders]
        return rows


def time_in_turns(
    contenders: Sequence[TimedTracker], scans: Iterator[Scan], budget_s: float, advance: Callable[[], None]
) -> None:
    """Let every tracker take in the scans in turns; one whose processor time is used up drops out."""
    for scan in scans:
        for timed in contenders:
            if sum(timed.cpu_ms) < 1e3 * budget_s:
                timed.step(scan)
        advance()


def bench_scene(vehicles: int, steps: int, rng: np.random.Generator) -> tuple[SensorModel, Iterator[Scan]]:
    """Return the sensor and the scans of so many vehicles in range beside the ego, all in plain view."""
    road = highway(LANES)
    rows = vehicles // (2 * LANES) + 2
    along = SPACING_M * np.arange(-rows, rows + 1)
    lane = np.repeat(np.arange(LANES), len(along))
    lon_m = np.tile(along, LANES) + rng.uniform(-0.5 * JITTER_M, 0.5 * JITTER_M, len(lane))
    lat_m = np.array([strip.centre_m for strip in road.lanes])[lane]
    is_ego = (lane == LANES // 2) & (np.tile(along, LANES) == 0.0)
    lon_m, lat_m = lon_m[~is_ego], lat_m[~is_ego]
    distance_m = np.hypot(lon_m, lat_m - road.lanes[LANES // 2].centre_m)
    nearest = np.argsort(distance_m)[:vehicles]
    range_m = float(distance_m[nearest[-1]]) + 5.0
    width_m = LANES * (road.lanes[0].left_m - road.lanes[0].right_m)
    sensor = SensorModel(range_m=range_m, clutter_area_m2=2.0 * range_m * width_m)
    return sensor, (_scan(step, lon_m[nearest], lat_m[nearest], sensor, width_m, rng) for step in range(steps))


def _scan(
    step: int, lon_m: np.ndarray, lat_m: np.ndarray, sensor: SensorModel, width_m: float, rng: np.random.Generator
) -> Scan:
    ego = EgoPose(SPEED_MPS * step * STEP_S, 0.5 * width_m, 0.0, SPEED_MPS, 4.7, 1.9)
    seen = np.flatnonzero(rng.random(len(lon_m)) < sensor.detection_probability)
    false = int(rng.poisson(sensor.clutter_per_scan))
    range_m = sensor.range_m
    lon = np.append(lon_m[seen] + rng.normal(0.0, STD_LON_M, len(seen)), rng.uniform(-range_m, range_m, false))
    lat = np.append(lat_m[seen] + rng.normal(0.0, STD_LAT_M, len(seen)), rng.uniform(0.0, width_m, false))
    order = rng.permutation(len(lon))
    unmeasured, like = np.full(len(lon), np.nan), np.ones(len(lon))
    found = Detections(
        lon_m=ego.lon_m + lon[order],
        lat_m=lat[order],
        speed_mps=unmeasured,
        std_lon_m=STD_LON_M * like,
        std_lat_m=STD_LAT_M * like,
        std_speed_mps=unmeasured,
    )
    return Scan(step * STEP_S, found, ego)
