"""What is kept beside a run's tables: the moment for the picture, the filter's diagnostics, a sample of particles."""

from array import array
from collections.abc import MutableSequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from harness.running.recorder import when_of
from harness.sensor.observation import Snapshot
from harness.storage.run_folder import DIAGNOSTICS
from harness.storage.schema import TABLES
from harness.trackers.protocol import AnyTracker
from mmpf.belief.mixture import Mixture, ParticleCloud
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import Float32Array, FloatArray, IntArray
from mmpf.stages.reporting import StepReport
from mmpf.tracks import HIDDEN, Tracks


def cloud_of(tracker: AnyTracker) -> ParticleCloud | None:
    """Return a tracker's particles after the last scan, of its attribute ``mixture``; None of one without any."""
    mixture = getattr(tracker, "mixture", None)
    return mixture.cloud if isinstance(mixture, Mixture) else None


def report_of(tracker: AnyTracker) -> StepReport | None:
    """Return the diagnostics of a tracker's last step, its attribute ``last_report``; None of one that tells none."""
    report = getattr(tracker, "last_report", None)
    return report if isinstance(report, StepReport) else None


@dataclass(frozen=True)
class RunMoment:
    """One instant of a run; ``particles`` are the places of all, shape (2, n), None where a tracker has none."""

    snapshot: Snapshot
    tracks: Tracks
    particles: FloatArray | None


@dataclass
class MomentKeeper:
    """Keeps the moment with the most hidden tracks on the road on record, the first of equals; None before a step."""

    moment: RunMoment | None = None
    _best: int = -1

    def watch(self, snapshot: Snapshot, tracks: Tracks, tracker: AnyTracker) -> None:
        """Look at one step."""
        start_m, end_m = snapshot.frame.window_m
        hidden = int(np.count_nonzero((tracks.state == HIDDEN) & (tracks.lon_m >= start_m) & (tracks.lon_m <= end_m)))
        if hidden <= self._best:
            return
        self._best = hidden
        cloud = cloud_of(tracker)
        self.moment = RunMoment(snapshot, tracks, None if cloud is None else cloud.state[[LON, LAT]])


DECIMALS = 6


@dataclass
class DiagnosticsKeeper:
    """Collects the reports of a run's steps, and the wall time of each of the tracker's stages."""

    stages_ms: dict[str, MutableSequence[float]] = field(default_factory=dict)
    _rows: list[dict[str, float]] = field(default_factory=list)

    def watch(self, snapshot: Snapshot, tracks: Tracks, tracker: AnyTracker) -> None:  # noqa: ARG002
        """Look at one step; a tracker that tells nothing leaves no row."""
        if (report := report_of(tracker)) is None:
            return
        when = when_of(snapshot.frame)
        # The wall times of the stages are no part of the table: equal runs give equal tables.
        names = (name for name in TABLES[DIAGNOSTICS].needed if name not in when)
        self._rows.append(when | {name: getattr(report, name) for name in names})
        for stage, took_ms in report.stage_ms.items():
            self.stages_ms.setdefault(stage, array("d")).append(took_ms)

    def table(self) -> pd.DataFrame | None:
        """Return one row per step, None if the tracker told nothing."""
        return pd.DataFrame(self._rows).round(DECIMALS) if self._rows else None

    def forget(self) -> None:
        """Let go of the rows, but not of the wall times."""
        self._rows.clear()


SHOWN_PER_COMPONENT = 12
PLACE_DECIMALS = 2


@dataclass
class ParticleKeeper:
    """Collects a few particles of every component at every step, of trackers that have particles."""

    _steps: list[tuple[int, Float32Array]] = field(default_factory=list)

    def watch(self, snapshot: Snapshot, tracks: Tracks, tracker: AnyTracker) -> None:  # noqa: ARG002
        """Look at one step."""
        if (cloud := cloud_of(tracker)) is None:
            return
        shown = systematic_sample(cloud, SHOWN_PER_COMPONENT)
        places = np.round([cloud.state[LON].take(shown), cloud.state[LAT].take(shown)], PLACE_DECIMALS)
        self._steps.append((snapshot.frame.step, places.astype(np.float32)))

    def table(self) -> pd.DataFrame | None:
        """Return columns step, lon_m, lat_m; None without any particle."""
        if not self._steps:
            return None
        steps, places = zip(*self._steps, strict=True)
        lon_m, lat_m = np.concatenate(places, axis=1)
        step = np.repeat(steps, [each.shape[1] for each in places])
        return pd.DataFrame({"step": step, "lon_m": lon_m, "lat_m": lat_m})

    def forget(self) -> None:
        """Let go of the rows."""
        self._steps.clear()


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
