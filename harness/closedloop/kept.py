"""An episode that ended in a collision as a run folder of its own, to be looked at."""

from __future__ import annotations

from pathlib import Path

from harness.closedloop.episode import Drove
from harness.closedloop.plan import PlannedDrive
from harness.running.evaluate import Evaluated, tables_of, write_run
from harness.running.metrics import traffic_table
from harness.running.open import driven_on
from harness.scoring import score_run
from harness.storage import run_folder as runfolder
from harness.truth.frame import STEP_S
from mmpf.map.road import Road


def keep_drive(folder: Path, run: PlannedDrive, road: Road, drove: Drove) -> None:
    """Write the folder; its manifest says that no ``run`` makes it again, since the ego was driven by a belief."""
    recorded, times, config = drove.tables, drove.times, run.config
    truth, detections, tracks = recorded.truth, recorded.detections, recorded.tracks
    scored = score_run(truth, detections, tracks, config.seed, driven_on(road, config))
    tables = {runfolder.TRUTH: truth, runfolder.DETECTIONS: detections, runfolder.TRACKS: tracks, **tables_of(scored)}
    evaluated = Evaluated(road, tables, scored.metrics, traffic_table(truth, road), times, STEP_S)
    metrics = evaluated.metrics(config, drove.table, sum(times.tracker_s))
    write_run(folder, evaluated, metrics, config, f"harness drive: episode {run.key}")
