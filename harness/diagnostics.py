"""What goes on inside a tracker that tells: one row of figures for each step, and where its time goes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import pandas as pd

from harness.cosim import AnyTracker
from harness.sensor.observation import Observation
from harness.truth.frame import Frame
from mmpf.state import Tracks
from mmpf.tracker import StepReport

# The wall times of the stages are no part of the table: equal runs give equal tables.
COLUMNS = (
    "components",
    "effective_share",
    "births",
    "deaths",
    "merges",
    "reclusterings",
    "association_entropy",
)
DECIMALS = 6


@runtime_checkable
class DiagnosedTracker(Protocol):
    """A tracker that tells what happened inside its last step."""

    @property
    def last_report(self) -> StepReport:
        """What happened inside the last step."""
        ...


@dataclass
class DiagnosticsKeeper:
    """Collects the reports of a run's steps.

    Attributes:
        stages_ms: Wall time of each of the tracker's stages, step by step.
    """

    stages_ms: dict[str, list[float]] = field(default_factory=dict)
    _rows: list[dict[str, float]] = field(default_factory=list)

    def watch(self, frame: Frame, observation: Observation, tracks: Tracks, tracker: AnyTracker) -> None:  # noqa: ARG002
        """Look at one step; a tracker that tells nothing leaves no row."""
        if not isinstance(tracker, DiagnosedTracker):
            return
        report = tracker.last_report
        when = {"step": frame.step, "time_s": frame.time_s, "episode": frame.episode}
        self._rows.append(when | {name: getattr(report, name) for name in COLUMNS})
        for stage, took_ms in report.stage_ms.items():
            self.stages_ms.setdefault(stage, []).append(took_ms)

    def table(self) -> pd.DataFrame | None:
        """Return one row per step, None if the tracker told nothing."""
        return pd.DataFrame(self._rows).round(DECIMALS) if self._rows else None
