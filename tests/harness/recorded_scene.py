"""A run folder made by hand, with one occlusion whose outcome is known.

Three cars drive at 20 m/s on a straight five-lane road for 6 s: the ego; *near*, always in view and followed by track 1
within 0.1 m; and *far*, detected up to 2 s, hidden from then on and seen again from 4 s. Track 2 holds *far*, is 3 m
ahead of it from 2 s on, and is given up at 3 s; track 3 follows *far* from 4.3 s on. A fourth car, *distant*, is out of
range all the time.
"""

import json
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from harness.config.model import RunConfig
from harness.running.evaluate import Evaluated, write_run
from harness.running.follow import StageTimes
from harness.running.metrics import TrafficSums
from harness.running.resolve import resolve_run_config
from harness.storage import run_folder as runfolder
from harness.storage.checks import rows_of
from harness.storage.manifest import hashes_of
from harness.storage.tables import write_table
from mmpf.map.corridor_road import highway
from mmpf.map.road import Road
from tests.harness.scoring.scenes import score_run

COMMAND = "harness run"
STEPS, STEP_S, SPEED_MPS = 60, 0.1, 20.0
LAST_SEEN, SEEN_AGAIN, GIVEN_UP, NEW_TRACK = 20, 40, 30, 43


def write_recorded_scene(folder: Path, names: dict[str, str] | None = None, **options: Any) -> Path:
    """Write the folder; vehicles can be given other names."""
    if not (names or options):
        for file, content in usual_files().items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_bytes(content)
        return folder
    return written_scene(folder, names, **options)


@cache
def usual_files() -> dict[Path, bytes]:
    """Return the files of the scene without options, by their places in it: made once, and copied then."""
    with TemporaryDirectory() as kept:
        scene = written_scene(Path(kept) / "scene")
        return {path.relative_to(scene): path.read_bytes() for path in scene.rglob("*") if path.is_file()}


def written_scene(
    folder: Path,
    names: dict[str, str] | None = None,
    road: Road | None = None,
    config: RunConfig | None = None,
    command: str = COMMAND,
) -> Path:
    road = road or highway()
    config = config or resolve_run_config(options={"seed": 7, "duration": STEPS * STEP_S, "model": "cvm"})
    truth, detections, tracks = truth_table(names or {}), detection_table(names or {}), track_table()
    scored = score_run(truth, detections, tracks, config.seed)
    tables = {
        runfolder.TRUTH: truth, runfolder.DETECTIONS: detections, runfolder.TRACKS: tracks,
        runfolder.ERRORS: scored.errors, runfolder.EVENTS: scored.events,
    }  # fmt: skip
    times = StageTimes(*([value_s] * STEPS for value_s in (0.001, 0.002, 0.01, 0.003)))
    traffic = TrafficSums(road)
    traffic.add(truth)
    evaluated = Evaluated(road, tables, scored.metrics, traffic.table(), times, STEP_S)
    write_run(folder, evaluated, evaluated.metrics(config, {}, 1.0), config, command)
    return folder


def truth_table(names: dict[str, str]) -> pd.DataFrame:
    return pd.DataFrame(
        [truth_row(step, name, names) for step in range(STEPS) for name in ("ego", "near", "far", "distant")]
    )


def truth_row(step: int, name: str, names: dict[str, str]) -> dict[str, object]:
    hidden = name == "far" and LAST_SEEN < step < SEEN_AGAIN
    state = {"distant": "out"}.get(name, "hidden" if hidden else "visible")
    ahead = {"ego": 0.0, "near": 15.0, "far": 40.0, "distant": 250.0}[name]
    return {
        **when(step), "vehicle_id": names.get(name, name), "lon_m": 100.0 + ahead + SPEED_MPS * step * STEP_S,
        "lat_m": 5.0, "heading_rad": 0.02 if name == "far" else 0.0, "speed_mps": SPEED_MPS, "lat_speed_mps": 0.0,
        "accel_mps2": 0.0, "lane": 4, "length_m": 4.5, "width_m": 1.8, "is_ego": name == "ego",
        "in_range": name != "distant", "visible_fraction": float(state == "visible"), "state": state, "occluder_id": "",
    }  # fmt: skip


def detection_table(names: dict[str, str]) -> pd.DataFrame:
    truth = truth_table(names)
    seen = truth[(truth["state"] == "visible") & ~truth["is_ego"]].reset_index(drop=True)
    columns = ["step", "time_s", "episode", "detection", "lon_m", "lat_m", "speed_mps"]
    return seen.assign(detection=seen.index, speed_mps=np.nan)[columns].assign(
        std_lon_m=0.3, std_lat_m=0.2, std_speed_mps=np.nan, visible_fraction=1.0, truth_id=seen["vehicle_id"]
    )


def track_table() -> pd.DataFrame:
    rows = []
    for step in range(STEPS):
        rows.append(track_row(step, 1, "near", 0.1, "confirmed"))
        if step < GIVEN_UP:
            unseen = step > LAST_SEEN
            rows.append(track_row(step, 2, "far", 3.0 if unseen else 0.1, "hidden" if unseen else "confirmed"))
        if step >= NEW_TRACK:
            rows.append(track_row(step, 3, "far", 0.1, "confirmed"))
    return pd.DataFrame(rows)


def track_row(step: int, number: int, follows: str, ahead_m: float, state: str) -> dict[str, object]:
    truth = truth_row(step, follows, {})
    return {
        **when(step), "track_id": number, "lon_m": truth["lon_m"] + ahead_m, "lat_m": truth["lat_m"],
        "speed_mps": SPEED_MPS, "lat_speed_mps": 0.0, "accel_mps2": 0.0, "std_lon_m": 0.5, "std_lat_m": 0.25,
        "std_speed_mps": 1.0, "existence": 0.99, "state": state,
    }  # fmt: skip


def when(step: int) -> dict[str, object]:
    return {"step": step, "time_s": round(step * STEP_S, 1), "episode": 0}


def metrics_of(folder: Path) -> dict:
    return json.loads((folder / runfolder.METRICS).read_text(encoding="utf-8"))


def rewrite(folder: Path, name: str, table: pd.DataFrame) -> None:
    """Put another table in a run folder's place of one, as if the run had left it."""
    write_table(table, folder / name)
    manifest = json.loads((folder / runfolder.MANIFEST).read_text())
    noted = {"rows": rows_of(folder), "files_sha256": hashes_of(folder)}
    (folder / runfolder.MANIFEST).write_text(json.dumps(manifest | noted))


def write_lost_and_kept(folder: Path) -> tuple[Path, Path]:
    """Write a run that loses *far*, and one on the same detections that follows it 1 m ahead all the time."""
    lost, kept = (write_recorded_scene(folder / name) for name in ("lost", "kept"))
    errors = pd.read_parquet(kept / runfolder.ERRORS).astype({"outcome": object})
    far = (errors["vehicle_id"] == "far").to_numpy()
    errors.loc[far, ["track_id", "lon_error_m", "lat_error_m", "outcome"]] = [2, 1.0, 0.0, "tracked"]
    rewrite(kept, runfolder.ERRORS, errors)
    return lost, kept
