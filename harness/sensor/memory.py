"""The sensor's state between scans: which vehicles it fails to detect, and how their boxes drift.

All randomness that lasts is drawn from streams of its own, in blocks that depend on the number of vehicles alone. A
detector that forgets everything therefore draws what it would draw without a memory.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, StringArray

NORMALS = 7
"""Standard normal numbers of a vehicle: longitudinal, lateral, along, across, speed, length, width."""


class Chain(NamedTuple):
    """A state that comes in runs.

    Attributes:
        share: Share of time in the state, below 1, shape (n,) or a number.
        run_s: Mean length of a run in it, seconds, likewise.
    """

    share: FloatArray | float
    run_s: FloatArray | float


def next_state(chain: Chain, before: FloatArray, step_s: float, uniforms: FloatArray) -> BoolArray:
    """Draw whether each of n two-state chains is in its state now, shape (n,).

    At each step a chain keeps its former state with the probability 1 - step / (run (1 - share)), else draws it anew
    with the probability ``share``. So runs last ``run_s`` on average; shorter ones than independent draws' can't be.

    Args:
        chain: Shares and mean run lengths.
        before: 1 or 0 for the state a step ago; nan where there was none, shape (n,).
        step_s: Time since then.
        uniforms: Uniform random numbers, shape (n,).
    """
    share = np.broadcast_to(np.asarray(chain.share, dtype=np.float64), before.shape)
    run_s = np.broadcast_to(np.asarray(chain.run_s, dtype=np.float64), before.shape)
    held = np.clip(1.0 - step_s / np.maximum(run_s * (1.0 - share), 1e-12), 0.0, 1.0)
    chance = np.where(np.isnan(before), share, share + held * (before - share))
    return np.asarray(uniforms < chance)


@dataclass(frozen=True)
class VehicleMemory:
    """What is remembered of n vehicles, struct of arrays.

    Attributes:
        missed: 1 where a vehicle is in a run of misses, 0 elsewhere, nan if it is new; shape (n,).
        drift: Standard normal numbers that drift, nan if new, shape (n, ``NORMALS``).
    """

    vehicle_id: StringArray
    missed: FloatArray
    burst: FloatArray
    split: FloatArray
    merged: FloatArray
    drift: FloatArray

    @classmethod
    def none_of(cls, vehicle_id: StringArray) -> VehicleMemory:
        """Return the memory of vehicles that were never met."""
        count = len(vehicle_id)
        unknown = np.full(count, np.nan)
        return cls(vehicle_id, unknown, unknown, unknown, unknown, np.full((count, NORMALS), np.nan))

    def of(self, vehicle_id: StringArray) -> VehicleMemory:
        """Return what is remembered of these vehicles, in their order."""
        row = {str(name): k for k, name in enumerate(self.vehicle_id)}
        index = np.array([row.get(str(name), -1) for name in vehicle_id], dtype=np.int64)
        columns = (self.missed, self.burst, self.split, self.merged, self.drift)
        return VehicleMemory(vehicle_id, *(_taken_or_nan(column, index) for column in columns))


def _taken_or_nan(column: FloatArray, index: IntArray) -> FloatArray:
    taken = np.full((len(index), *column.shape[1:]), np.nan)
    known = index >= 0
    taken[known] = column[index[known]]
    return taken


def drifted(drift: FloatArray, step_s: float, time_s: float, normals: FloatArray) -> FloatArray:
    """Return Ornstein-Uhlenbeck processes of standard deviation 1 a step later, shape (n, k); nan begins anew."""
    kept = np.exp(-step_s / time_s) if time_s > 0.0 else 0.0
    return np.where(np.isnan(drift), normals, kept * drift + np.sqrt(1.0 - kept**2) * normals)


@dataclass(frozen=True)
class Ghosts:
    """False objects that stay in view for a while, arrays of shape (g,); the speed is along the box's axis."""

    lon_m: FloatArray
    lat_m: FloatArray
    axis_rad: FloatArray
    speed_mps: FloatArray
    length_m: FloatArray
    width_m: FloatArray

    def __len__(self) -> int:
        return len(self.lon_m)

    @classmethod
    def none(cls) -> Ghosts:
        """Return no ghosts."""
        return cls(*(np.zeros(0) for _ in range(6)))


@dataclass(frozen=True)
class Mirrored:
    """False objects that mirror a vehicle, by how far ahead and to the left of it, along its box, shape (g,)."""

    vehicle_id: StringArray
    along_m: FloatArray
    left_m: FloatArray

    def __len__(self) -> int:
        return len(self.vehicle_id)


@dataclass(frozen=True)
class SensorStreams:
    """Independent streams of randomness, so that no failing shifts the draws of another."""

    misses: np.random.Generator
    boxes: np.random.Generator
    drift: np.random.Generator
    reports: np.random.Generator
    ghosts: np.random.Generator
    detectability: np.random.Generator
    mirrored: np.random.Generator
    posts: np.random.Generator
    scores: np.random.Generator
    classes: np.random.Generator

    @classmethod
    def below(cls, parent: np.random.Generator) -> SensorStreams:
        """Return streams that the parent's seed decides; the parent's own numbers stay as they were."""
        own = parent.spawn(5)
        # Streams that came later lie below the first, so that the parent's next children stay what they were.
        return cls(*own, *own[0].spawn(5))


@dataclass
class SensorMemory:
    """All that one sensor remembers within one episode.

    Attributes:
        posts: What stands beside the road for the whole run; None before its first scan.
        detectability: Factor on the detection probability of each vehicle that was met in the run, by name.
        pending: Times and contents of scans that were made but not handed out yet, oldest first.
    """

    parent: np.random.Generator | None = None
    streams: SensorStreams = field(init=False)
    episode: int = -1
    time_s: float = 0.0
    vehicles: VehicleMemory = field(init=False)
    ghosts: Ghosts | None = None
    mirrored: Mirrored | None = None
    posts: Ghosts | None = None
    detectability: dict[str, float] = field(default_factory=dict)
    pending: list[tuple[float, object]] = field(default_factory=list)

    def begin_scan(self, parent: np.random.Generator, episode: int, time_s: float) -> float:
        """Forget what does not belong to this episode; return the time since its last scan, seconds."""
        if self.parent is not parent:
            self.parent, self.streams, self.episode = parent, SensorStreams.below(parent), -1
            self.posts, self.detectability = None, {}
        step_s = time_s - self.time_s
        if self.episode != episode:
            self.episode, self.ghosts, self.mirrored, step_s = episode, None, None, 0.0
            self.vehicles = VehicleMemory.none_of(np.zeros(0, dtype=np.str_))
            self.pending.clear()
        self.time_s = time_s
        return step_s
