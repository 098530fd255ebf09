"""Recomputes the scores of a run from the tables in its folder."""

from __future__ import annotations

from pathlib import Path

from harness.scoring.evidence.settings import ScoringSettings
from harness.scoring.gathered import Evidence, gather
from harness.storage import run_folder as runfolder
from harness.storage.checks import sound_tables

COMPARE = "compare"


def evidence_of(folder: Path) -> Evidence:
    """Return what scoring finds out about a run.

    Args:
        folder: The folder of a finished run.

    Raises:
        InputError: A table is missing or broken.
    """
    with sound_tables(folder, COMPARE):
        return gather(
            runfolder.read_table(folder, runfolder.TRUTH, COMPARE),
            runfolder.read_table(folder, runfolder.DETECTIONS, COMPARE),
            runfolder.read_table(folder, runfolder.TRACKS, COMPARE),
            ScoringSettings(),
            0,
        )
