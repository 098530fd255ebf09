"""The failure gallery: each failure as a row of pictures from above.

Vehicles in plain view without a track come first, then the worst occlusion events.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from harness.report.strips import save_strips
from harness.report.top_view import (
    HALF_WINDOW_M,
    MARGIN_M,
    Subject,
    across,
    direction_words,
    draw_moment,
    draw_scale,
)
from harness.report.withheld_gallery import withheld_vehicles
from harness.running.finished import RecordedRun
from harness.scoring.evidence.settings import ScoringSettings
from harness.storage.tables import floats

WORST = 5
GALLERY = "gallery"
AFTERWARDS_S = 0.5
COLUMNS, PANEL_WIDTH_IN = 3, 4.0
HEAD_IN, ROW_IN, FOOT_IN, GAP_IN = 0.56, 0.56, 0.3, 0.12
"""Above the first row, between two rows, below the last, and at the sides of each picture."""
KEY = (
    "thick box: the vehicle",
    "bold ellipse: the track that held it, 95 %,",
    "    dashed while the tracker takes it for hidden",
    "thin ellipses: other tracks; crosses: detections",
    "grey: the sensor's shadows",
)
EVENT_COLUMNS = ("vehicle_id", "track_id", "outcome", "from_step", "to_step", "duration_s")
SEVERITY = {"lost": 0, "hijacked": 0, "survived": 1, "same_id": 2}


class Failure(Protocol):
    """What a strip shows."""

    @property
    def vehicle_id(self) -> str:
        """Return the vehicle."""

    @property
    def subject(self) -> Subject:
        """Return what the pictures are about."""

    def sentence(self) -> str:
        """Return a sentence on what happened."""

    def moments(self, run: RecordedRun) -> list[tuple[int, str]]:
        """Return the steps that are drawn, with their headings."""

    def replayed_s(self, run: RecordedRun) -> tuple[float, float]:
        """Return when the replay begins and stops."""


@dataclass(frozen=True)
class OcclusionEvent:
    """One occlusion of a tracked vehicle, until it is seen again.

    Attributes:
        track_id: The track that held it before, -1 if none.
        outcome: ``lost``, ``hijacked``, ``survived`` (alive, but not on the vehicle) or ``same_id``.
        from_step: Step of the last detection before; ``to_step`` is that of the first after.
        largest_error_m: Largest distance between the vehicle and that track in between; nan if none was measured.
    """

    vehicle_id: str
    track_id: int
    outcome: str
    from_step: int
    to_step: int
    duration_s: float
    largest_error_m: float

    def sentence(self) -> str:
        """Return a sentence on what happened."""
        kept = f"track {self.track_id}"
        ends = {
            "lost": f"its {kept} was deleted" if self.track_id >= 0 else "it had no track before",
            "hijacked": f"its {kept} was on another vehicle afterwards",
            "survived": f"its {kept} lived on, but not on this vehicle",
            "same_id": f"{kept} followed it again afterwards",
        }
        error = f", at most {self.largest_error_m:.1f} m off while hidden" if np.isfinite(self.largest_error_m) else ""
        return f"{self.vehicle_id}, hidden for {self.duration_s:.1f} s: {ends[self.outcome]}{error}."

    @property
    def subject(self) -> Subject:
        """What its pictures are about."""
        return Subject(self.vehicle_id, self.track_id)

    def moments(self, run: RecordedRun) -> list[tuple[int, str]]:
        """Return the steps that are drawn, with their headings; the last is when the outcome is judged."""
        steps, first = np.unique(run.truth["step"].to_numpy(dtype=np.int64), return_index=True)
        times, episodes = floats(run.truth, "time_s")[first], run.truth["episode"].to_numpy(dtype=np.int64)[first]
        at = {int(step): float(time) for step, time in zip(steps, times, strict=True)}
        start_s, end_s = at[self.from_step], at[self.to_step]
        same_ego = episodes == episodes[np.searchsorted(steps, self.to_step)]
        judged_s = min(end_s + ScoringSettings().event_judged_s, float(times[same_ego].max()))

        def nearest(time_s: float) -> int:
            return int(steps[np.argmin(np.abs(times - time_s))])

        chosen = [(self.from_step, f"last seen, {start_s:.1f} s")]
        for share in (1.0 / 3.0, 2.0 / 3.0):
            step = nearest(start_s + share * (end_s - start_s))
            chosen.append((step, f"hidden for {at[step] - start_s:.1f} s"))
        chosen.append((self.to_step, f"seen again, {end_s:.1f} s"))
        chosen.append((nearest(judged_s), f"{judged_s - end_s:.1f} s later"))
        return chosen

    def replayed_s(self, run: RecordedRun) -> tuple[float, float]:
        """Return when the replay begins and stops."""
        begin_s = float(run.truth.drop_duplicates("step").set_index("step")["time_s"][self.from_step])
        return begin_s, begin_s + self.duration_s + AFTERWARDS_S


def worst_failures(run: RecordedRun) -> list[Failure]:
    """Return what the gallery shows, in order."""
    return [*withheld_vehicles(run), *worst_events(run.events, run.errors)]


def worst_events(events: pd.DataFrame, errors: pd.DataFrame, count: int = WORST) -> list[OcclusionEvent]:
    """Return the worst events: lost and hijacked tracks first, then the largest error, then the longest."""
    distance = np.hypot(floats(errors, "lon_error_m"), floats(errors, "lat_error_m"))
    by_vehicle = errors.groupby("vehicle_id", sort=False).indices
    step, track = errors["step"].to_numpy(), errors["track_id"].to_numpy()
    found = []
    for event in events.astype({"vehicle_id": object, "outcome": object}).to_dict("records"):
        at = by_vehicle.get(event["vehicle_id"], np.zeros(0, dtype=np.int64))
        during = at[(step[at] > event["from_step"]) & (step[at] < event["to_step"]) & (track[at] == event["track_id"])]
        off = distance[during][np.isfinite(distance[during])]
        known = {str(column): event[column] for column in EVENT_COLUMNS}
        found.append(OcclusionEvent(**known, largest_error_m=float(off.max()) if len(off) else np.nan))
    found.sort(key=lambda event: (SEVERITY[event.outcome], -np.nan_to_num(event.largest_error_m), -event.duration_s))
    return found[:count]


def draw_gallery(run: RecordedRun, failures: Sequence[Failure], folder: Path) -> list[Path]:
    """Write ``gallery-1.png`` and so on, one strip for each failure, in place of an earlier report's."""
    return save_strips((strip_figure(run, failure) for failure in failures), folder, GALLERY)


def strip_figure(run: RecordedRun, event: Failure) -> Figure:
    """Return five pictures of a failure, driving direction to the right as in the replay, the vehicle in the middle."""
    moments, subject = event.moments(run), event.subject
    low, high = across(run.road)
    panel_height_in = PANEL_WIDTH_IN * (high - low + 2.0 * MARGIN_M) / (2.0 * HALF_WINDOW_M)
    rows = -(-(len(moments) + 1) // COLUMNS)
    width_in = COLUMNS * (PANEL_WIDTH_IN + GAP_IN) + GAP_IN
    height_in = HEAD_IN + rows * panel_height_in + (rows - 1) * ROW_IN + FOOT_IN
    figure = Figure(figsize=(width_in, height_in), dpi=110)

    def corner(place: int) -> tuple[float, float]:
        row, column = divmod(place, COLUMNS)
        bottom = height_in - HEAD_IN - (row + 1) * panel_height_in - row * ROW_IN
        return (GAP_IN + column * (PANEL_WIDTH_IN + GAP_IN)) / width_in, bottom / height_in

    for place, (step, heading) in enumerate(moments):
        axes = figure.add_axes((*corner(place), PANEL_WIDTH_IN / width_in, panel_height_in / height_in))
        axes.set_title(heading, fontsize=9.5, pad=4)
        axes.set_xlabel(draw_moment(axes, run, subject, step), fontsize=8.5, color="#333333", labelpad=3)
    figure.text(GAP_IN / width_in, 1.0 - 0.09 / height_in, event.sentence(), fontsize=10.5, va="top")
    left, bottom = corner(len(moments))
    top = bottom + panel_height_in / height_in
    key = (direction_words(run.road), *KEY)
    figure.text(left + 0.1 / width_in, top, "\n".join(key), fontsize=9, color="#444444", va="top", linespacing=1.5)
    draw_scale(figure.axes[0])
    return figure
