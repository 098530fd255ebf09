"""Space-time fields of traffic: speed, flow and density on cells of road and time, by Edie's definitions.

A cell's density is the time that vehicles spend in it over its area (length x duration), its flow the distance that
they travel in it over its area, its speed the distance over the time (Edie, Discussion of traffic stream measurements
and definitions, 1963). Recorded and simulated traffic are laid on the same cells, all lanes together.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.common.errors import InputError
from harness.truth.frame import Frame
from mmpf.map.road import NO_LANE
from mmpf.numerics.arrays import FloatArray

FOOT_M = 0.3048
CELL_M = 20.0 * FOOT_M
CELLS = 104
BIN_S = 5.0
FIELD_FILES = {
    "speed": "NGSIM_US101_Velocity_Data.txt",
    "flow": "NGSIM_US101_Flow_Data.txt",
    "density": "NGSIM_US101_Density_Data.txt",
}


@dataclass(frozen=True)
class Fields:
    """Traffic on cells of ``CELL_M`` and ``BIN_S``, each array of shape (cells, bins), row 0 upstream, all lanes.

    Attributes:
        speed_mps: Space-mean speed; nan where no vehicle was.
    """

    speed_mps: FloatArray
    flow_veh_per_s: FloatArray
    density_veh_per_m: FloatArray

    @property
    def duration_s(self) -> float:
        """Time that the fields cover."""
        return float(self.speed_mps.shape[1] * BIN_S)

    def between(self, start_s: float, end_s: float) -> Fields:
        """Return the bins that begin within a time, ``end_s`` excluded."""
        begins = np.arange(self.speed_mps.shape[1]) * BIN_S
        chosen = (begins >= start_s - 1e-9) & (begins < end_s - 1e-9)
        return Fields(*(values[:, chosen] for values in (self.speed_mps, self.flow_veh_per_s, self.density_veh_per_m)))


def fields_from_frames(frames: Iterable[Frame], step_s: float, cells: int = CELLS) -> Fields:
    """Lay the vehicles of a truth source on the cells, from the start of its road frame on.

    Vehicles are placed by their front, as the recording places them, and those beside the lanes are left out. A last
    bin that is not full is dropped.
    """
    per_bin = round(BIN_S / step_s)
    time_spent, distance = [], []
    step = 0
    for step, frame in enumerate(frames, start=1):
        if (step - 1) % per_bin == 0:
            time_spent.append(np.zeros(cells))
            distance.append(np.zeros(cells))
        cell = np.floor((frame.lon_m + 0.5 * frame.length_m) / CELL_M).astype(np.int64)
        inside = (frame.lane != NO_LANE) & (cell >= 0) & (cell < cells)
        time_spent[-1] += step_s * np.bincount(cell[inside], minlength=cells)
        distance[-1] += step_s * np.bincount(cell[inside], weights=frame.speed_mps[inside], minlength=cells)
    full = step // per_bin
    if full == 0:
        raise ValueError(f"{step} frames of {step_s:g} s fill no bin of {BIN_S:g} s")
    total_s, total_m = np.stack(time_spent[:full], axis=1), np.stack(distance[:full], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = np.where(total_s > 0.0, total_m / total_s, np.nan)
    area = CELL_M * BIN_S
    return Fields(speed_mps=speed, flow_veh_per_s=total_m / area, density_veh_per_m=total_s / area)


def read_fields(folder: Path) -> Fields:
    """Read the recorded fields of US-101, which are in feet and seconds.

    Raises:
        InputError: A file is missing, is no table of numbers, or the three do not match.
    """
    speed, flow, density = (_read_table(folder / name) for name in FIELD_FILES.values())
    if not speed.shape == flow.shape == density.shape:
        raise InputError(f"`fields` {folder}: the tables of speed, flow and density differ in size")
    return Fields(speed_mps=speed * FOOT_M, flow_veh_per_s=flow, density_veh_per_m=density / FOOT_M)


def _read_table(path: Path) -> FloatArray:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an empty table is told below
            table = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(
            f"`fields`: {path} is missing or no table of numbers; give the folder that holds it"
        ) from error
    if table.size == 0 or not np.isfinite(table).all() or (table < 0.0).any():
        raise InputError(f"`fields`: {path} is empty or holds numbers that are negative or not finite")
    return np.asarray(table, dtype=np.float64)
