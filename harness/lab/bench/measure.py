"""Times trackers step by step on the same scans, in turns, so that a busy moment of the machine hits all alike."""

from __future__ import annotations

import resource
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

from harness.lab.bench.bench_scene import BenchScene
from harness.running.memory import keep_freed_memory
from harness.running.watchers import DiagnosedTracker
from harness.trackers.catalogue import build_tracker
from harness.trackers.protocol import Tracker, TrackerSetting, TruthAssociatedTracker
from harness.truth.frame import STEP_S
from mmpf.scan import Scan
from mmpf.tracks import TENTATIVE

SETTLING_STEPS = 20
SOONEST_STEPS = 5
FEWEST_STEPS = 3
WARM_UP_STEPS = 8


@dataclass(frozen=True)
class Contender:
    """A tracker with its options, as one line of the table.

    Attributes:
        label: What it is called.
        tracker: Name of the tracker.
        options: Its options.
        model: Name of the motion model, None where the tracker has its own.
        particles: Particles per vehicle, None where there are none.
    """

    label: str
    tracker: str
    options: Mapping[str, object] = field(default_factory=dict)
    model: str | None = None
    particles: int | None = None


@dataclass
class Stepping:
    """A contender on its way through a scene.

    Attributes:
        contender: Who.
        tracker: Its tracker.
        steps: Scans taken in so far.
        spent_s: Processor time so far.
        ms: Wall time of each step.
        cpu_ms: Processor time of each step.
        stages_ms: Wall time of the tracker's stages in each step after the first.
        peak_mb: Highest resident memory of the process while this tracker stepped, what the others hold included.
        tracks: Confirmed tracks after the last scan.
    """

    contender: Contender
    tracker: Tracker
    steps: int = 0
    spent_s: float = 0.0
    ms: list[float] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)
    stages_ms: dict[str, list[float]] = field(default_factory=dict)
    peak_mb: float = 0.0
    tracks: int = 0


def time_in_turns(
    contenders: Sequence[Contender], scene: BenchScene, budget_s: float, advance: Callable[[], None]
) -> list[Stepping]:
    """Let every contender take in the scans in turns; one whose processor time is used up drops out.

    ``advance`` is called after each scan.
    """
    field_of_all = [Stepping(contender, _build(contender, scene)) for contender in contenders]
    for scan in scene.scans:
        for stepping in field_of_all:
            if stepping.spent_s < budget_s:
                _step(stepping, scan)
        advance()
    return field_of_all


def warm_up(contenders: Sequence[Contender], scene: BenchScene) -> None:
    """Let throw-away trackers take a few scans, so that compiling and importing count in no measured step."""
    keep_freed_memory()
    for contender in contenders:
        tracker = _build(contender, scene)
        for scan in scene.scans[:WARM_UP_STEPS]:
            tracker.step(scan)


def as_row(stepping: Stepping, vehicles: int) -> dict[str, object]:
    """Return a contender's line of the table.

    The first 20 steps, while tracks settle, do not count. Of one whose time was up before, the last three count if
    its tracks stood by then; else the times are None.
    """
    settled = min(SETTLING_STEPS, stepping.steps - FEWEST_STEPS)
    measured = slice(settled, None) if settled >= SOONEST_STEPS else slice(0, 0)
    ms, cpu_ms = stepping.ms[measured], stepping.cpu_ms[measured]
    contender = stepping.contender
    return {
        "tracker": contender.label,
        "model": contender.model,
        "vehicles": vehicles,
        "particles": contender.particles,
        "ms_p50": _percentile(ms, 50),
        "ms_p95": _percentile(ms, 95),
        "cpu_ms_p50": _percentile(cpu_ms, 50),
        "peak_mb": stepping.peak_mb,
        "steps": len(ms),
        "tracks": stepping.tracks,
        "stages_ms_p50": {
            stage: _percentile(took_ms[-len(ms) :] if ms else [], 50) for stage, took_ms in stepping.stages_ms.items()
        },
    }


def _build(contender: Contender, scene: BenchScene) -> Tracker:
    setting = TrackerSetting(scene.road, scene.sensor, np.random.default_rng(0), STEP_S)
    tracker = build_tracker(contender.tracker, setting, contender.options)
    if isinstance(tracker, TruthAssociatedTracker):
        raise TypeError(f"{contender.tracker} is told the truth; it is a reference, not a tracker to be timed")
    return tracker


def _step(stepping: Stepping, scan: Scan) -> None:
    _forget_peak_memory()
    cpu_s, wall_s = process_time(), perf_counter()
    tracks = stepping.tracker.step(scan)
    wall_s, cpu_s = perf_counter() - wall_s, process_time() - cpu_s
    stepping.steps += 1
    stepping.spent_s += cpu_s
    stepping.peak_mb = max(stepping.peak_mb, _peak_memory_mb())
    stepping.tracks = int((tracks.state != TENTATIVE).sum())
    stepping.ms.append(1e3 * wall_s)
    stepping.cpu_ms.append(1e3 * cpu_s)
    if isinstance(stepping.tracker, DiagnosedTracker):
        for stage, took_ms in stepping.tracker.last_report.stage_ms.items():
            stepping.stages_ms.setdefault(stage, []).append(took_ms)


def _forget_peak_memory() -> None:
    """Let the kernel count the peak from now on; where it can't, the peak is that of the whole run."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def _peak_memory_mb() -> float:
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return next(float(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024.0
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _percentile(values: Sequence[float], percent: float) -> float | None:
    return float(np.percentile(values, percent)) if values else None
