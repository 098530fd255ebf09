"""Traffic recorded once for training, and stored for later runs.

Seeds serve training, tuning or reporting: no seed serves two purposes.
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import reduce
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.common.files import replacing
from harness.running.provenance import own_code
from harness.truth.frame import TruthSource
from harness.truth.network.network import Network
from harness.truth.recorded.traffic import RecordedTraffic
from harness.truth.sumo.simulation import open_traffic
from mmpf.numerics.arrays import FloatArray, IntArray, Rows, joined

DENSITIES_VEH_PER_KM_LANE = (8.0, 15.0, 22.0, 29.0, 36.0, 43.0, 50.0, 57.0)
FIRST_TRAINING_SEED = 1000
HELD_OUT_SEEDS = range(100, 101)
TRAINING_DURATION_S = 200.0
TUNING_DURATION_S = 100.0
REPORTING_DURATION_S = 60.0


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


def record(source: TruthSource) -> Recording:
    """Drain a source of truth into a recording and close it."""
    try:
        frames = list(source.frames())
    finally:
        source.close()
    own = {
        "step": np.repeat([frame.step for frame in frames], [len(frame) for frame in frames]),
        "vehicle": pd.factorize(np.concatenate([frame.vehicle_id for frame in frames]))[0],
    }
    names = [column.name for column in fields(Recording) if column.name not in own]
    return Recording(**own, **{name: np.concatenate([getattr(frame, name) for frame in frames]) for name in names})


def recording_of(traffic: RecordedTraffic) -> Recording:
    """Return recorded traffic as a recording; each stay is a vehicle."""
    own = {"step": traffic.step_of_row.astype(np.int64), "vehicle": traffic.stay, "lane": traffic.lane}
    columns: dict[str, Any] = {**own, **traffic.columns}
    return Recording(**{column.name: columns[column.name] for column in fields(Recording)})


def save_recording(recording: Recording, path: Path) -> None:
    """Write a recording so that no half-written file is ever found."""
    compact = {
        name: values.astype(np.int32 if values.dtype.kind == "i" else np.float32)
        for name, values in vars(recording).items()
    }
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **compact)


def load_recording(path: Path) -> Recording:
    """Read a recording back."""
    with np.load(path, allow_pickle=False) as stored:
        columns = {column.name: stored[column.name] for column in fields(Recording)}
    widened = {name: c.astype(np.int64 if c.dtype.kind == "i" else np.float64) for name, c in columns.items()}
    return Recording(**widened)


def load_all(paths: Sequence[Path]) -> Iterator[Recording]:
    """Read recordings one at a time, so that only one is held in memory."""
    return (load_recording(path) for path in paths)


def joined_apart(parts: Sequence[Rows], *identities: str) -> Rows:
    """Return several structs of arrays as one; what columns of numbers tell apart in each stays apart."""
    for identity in identities:
        numbers = [getattr(part, identity) for part in parts]
        first = np.cumsum([0, *[int(own.max(initial=-1)) + 1 for own in numbers[:-1]]])
        parts = [replace(part, **{identity: own + n}) for part, own, n in zip(parts, numbers, first, strict=True)]
    return reduce(joined, parts)


def first_to_last(seeds: range) -> str:
    """Return seeds in words."""
    return f"{seeds[0]} to {seeds[-1]}"


def traffic_version(network: Network) -> str:
    """Return the name of a network's present traffic: it changes with the road, the vehicle types and the drivers."""
    return f"{network.name}-{network.fingerprint()}"


def cache_of(network: Network) -> str:
    """Return the name of the folder for a network's recorded traffic: it changes with all that decides the traffic."""
    about = network.net_file.parent / "network.toml"
    section = about.read_text(encoding="utf-8") if about.is_file() else ""
    decides = chr(0).join((section, version("libsumo"), own_code()["harness/truth"]))
    return f"{traffic_version(network)}-{hashlib.sha256(decides.encode()).hexdigest()[:8]}"


def record_traffic(
    network: Network,
    seeds: Iterable[int],
    duration_s: float,
    cache: Path | None,
    say: Callable[[str], None],
    densities: Sequence[float] = DENSITIES_VEH_PER_KM_LANE,
) -> list[Path]:
    """Record each seed at each density, without an ego, if it has no file yet, one line to ``say``; return the files.

    They lie in ``cache``, or the usual folder, in a folder that differs for other networks and drivers.
    """
    folder = (cache or Path("results") / "cache" / "traffic") / cache_of(network)
    folder.mkdir(parents=True, exist_ok=True)
    wanted = [(density, seed) for seed in seeds for density in densities]
    paths = [folder / f"density{density:g}-seed{seed}-{duration_s:g}s.npz" for density, seed in wanted]
    for number, ((density, seed), path) in enumerate(zip(wanted, paths, strict=True), start=1):
        if not path.exists():
            recording = record(open_traffic(network, demand=density, duration_s=duration_s, seed=seed, ego=False))
            save_recording(recording, path)
            say(f"recorded {number}/{len(paths)}: {path.stem}, {len(recording)} rows")
    return paths
