"""An episode that ended in a collision as a run folder of its own, to be looked at."""

from __future__ import annotations

from pathlib import Path

from harness.closedloop.episode import Drove
from harness.closedloop.plan import PlannedDrive
from harness.grid.kept import Outcome, keep_run
from harness.running.metrics import assemble_metrics, timing_table, traffic_table
from harness.running.open import driven_on
from harness.scoring import score_run
from harness.truth.frame import STEP_S
from mmpf.map.road import Road


def keep_drive(folder: Path, run: PlannedDrive, road: Road, drove: Drove) -> None:
    """Write the folder; its manifest says that no ``run`` makes it again, since the ego was driven by a belief."""
    tables, times, config = drove.tables, drove.times, run.config
    scored = score_run(tables.truth, tables.detections, tables.tracks, config.seed, driven_on(road, config))
    timing = timing_table(times, STEP_S, sum(times.tracker_s))
    metrics = assemble_metrics(config, scored.metrics | dict(drove.table), timing, traffic_table(tables.truth, road))
    outcome = Outcome(tables, scored, metrics, len(times.tracker_s))
    keep_run(folder, config, road, outcome, f"harness drive: episode {run.key}")
