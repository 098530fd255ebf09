"""Traffic recorded once for training, and stored for later runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import numpy.typing as npt

from harness.truth.frame import Frame, TruthSource
from harness.truth.recorded.traffic import RecordedTraffic
from mmpf.numerics.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Scenario:
    """One stretch of simulated traffic at a demanded density."""

    density_veh_per_km_lane: float
    seed: int
    duration_s: float

    @property
    def file_name(self) -> str:
        """Name of the recording's file."""
        return f"density{self.density_veh_per_km_lane:g}-seed{self.seed}-{self.duration_s:g}s.npz"


@dataclass(frozen=True)
class Recording:
    """All vehicles at all steps of one scenario, one row each, arrays of shape (rows,), sorted by step.

    Attributes:
        accel_mps2: Longitudinal acceleration over the step that led to this frame.
    """

    step: IntArray
    vehicle: IntArray
    lane: IntArray
    lon_m: FloatArray
    lat_m: FloatArray
    speed_mps: FloatArray
    lat_speed_mps: FloatArray
    accel_mps2: FloatArray
    length_m: FloatArray

    def __len__(self) -> int:
        return len(self.step)


def record_all(
    scenarios: Sequence[Scenario],
    folder: Path,
    open_scenario: Callable[[Scenario], TruthSource],
    progress: Callable[[str], None],
) -> list[Path]:
    """Record every scenario that has no file yet; an interrupted run can be resumed."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / scenario.file_name for scenario in scenarios]
    for number, (scenario, path) in enumerate(zip(scenarios, paths, strict=True), start=1):
        if not path.exists():
            recording = record(open_scenario(scenario))
            save_recording(recording, path)
            progress(f"recorded {number}/{len(paths)}: {path.stem}, {len(recording)} rows")
    return paths


def record(source: TruthSource) -> Recording:
    """Drain a source of truth into a recording and close it."""
    numbers: dict[str, int] = {}
    try:
        tables = [_rows(frame, numbers) for frame in source.frames()]
    finally:
        source.close()
    columns = (np.concatenate(parts) for parts in zip(*tables, strict=True))
    return Recording(*columns)


def recording_of(traffic: RecordedTraffic) -> Recording:
    """Return recorded traffic as a recording; each stay is a vehicle."""
    columns = traffic.columns
    return Recording(
        step=traffic.step_of_row.astype(np.int64),
        vehicle=traffic.stay,
        lane=traffic.lane,
        lon_m=columns["lon_m"],
        lat_m=columns["lat_m"],
        speed_mps=columns["speed_mps"],
        lat_speed_mps=columns["lat_speed_mps"],
        accel_mps2=columns["accel_mps2"],
        length_m=columns["length_m"],
    )


def save_recording(recording: Recording, path: Path) -> None:
    """Write a recording under a temporary name and rename it, so that no half-written file is ever found."""
    compact = {
        column.name: values.astype(np.int32 if values.dtype.kind == "i" else np.float32)
        for column in fields(recording)
        for values in [getattr(recording, column.name)]
    }
    unfinished = path.with_suffix(f".{os.getpid()}.part")
    with unfinished.open("wb") as file:
        np.savez(file, allow_pickle=False, **compact)
    unfinished.replace(path)


def load_recording(path: Path) -> Recording:
    """Read a recording back."""
    with np.load(path, allow_pickle=False) as stored:
        columns = {column.name: stored[column.name] for column in fields(Recording)}
    widened = {name: c.astype(np.int64 if c.dtype.kind == "i" else np.float64) for name, c in columns.items()}
    return Recording(**widened)


def load_all(paths: Sequence[Path]) -> Iterator[Recording]:
    """Read recordings one at a time, so that only one is held in memory."""
    return (load_recording(path) for path in paths)


def _rows(frame: Frame, numbers: dict[str, int]) -> tuple[npt.NDArray[np.generic], ...]:
    vehicle = np.array([numbers.setdefault(str(name), len(numbers)) for name in frame.vehicle_id], dtype=np.int64)
    return (
        np.full(len(frame), frame.step, dtype=np.int64),
        vehicle,
        frame.lane.astype(np.int64),
        frame.lon_m,
        frame.lat_m,
        frame.speed_mps,
        frame.lat_speed_mps,
        frame.accel_mps2,
        frame.length_m,
    )
