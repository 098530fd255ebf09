"""The figures of one run."""

from __future__ import annotations

from pathlib import Path

from harness.moment import Moment
from harness.scoring import ScoredRun
from mmpf.road import Road
from mmpf.scan import SensorModel


def draw_figures(
    folder: Path,
    moment: Moment | None,
    road: Road,
    sensor: SensorModel,
    scored: ScoredRun,
) -> None:
    """Draw everything."""
