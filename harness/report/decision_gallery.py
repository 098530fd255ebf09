"""The gallery of decisions: a run's worst missed and phantom brakings, each as pictures and two curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.common.palette import PURPLE
from harness.report.strips import save_strips
from harness.report.top_view import (
    HALF_WINDOW_M,
    MARGIN_M,
    Subject,
    across,
    direction_words,
    draw_moment,
    draw_scale,
    rows_at,
)
from harness.running.finished import RecordedRun
from harness.scoring.evidence.settings import ScoringSettings
from harness.storage.tables import floats

WORST = 5
GALLERY = "decision"
PANELS, PANEL_WIDTH_IN = 3, 4.0
HEAD_IN, ROW_IN, CURVE_IN, FOOT_IN, GAP_IN = 0.56, 0.62, 1.5, 0.42, 0.12
AROUND_S = 3.0
UNSEEN_S = 0.5
KEY = (
    "bold ellipse: the track to blame, 95 %",
    "thick box: the vehicle to blame",
    "thin ellipses: other tracks; crosses: detections",
    "grey: the sensor's shadows",
    "yellow: while one demands braking and the other does not;",
    "    dotted: -2 m/s² (brakes) and -1 m/s² (does not)",
)
WHY_MISSED = {
    "none": "no track ever held it",
    "lost": "its track was given up",
    "displaced": "{track} follows it, but stands or moves otherwise than it does",
    "hijacked": "its {track} sits on another vehicle",
}
WHY_PHANTOM = {
    "ghost": "{track} follows no vehicle",
    "displaced": "{track} follows {vehicle}, but is not where that is",
    "hijacked": "{track} went over from another vehicle to {vehicle}",
}


@dataclass(frozen=True)
class Braking:
    """A missed or phantom braking; see ``harness.scoring.driving.brakings.braking_table``."""

    kind: str
    from_step: int
    to_step: int
    step: int
    duration_s: float
    truth_mps2: float
    tracks_mps2: float
    vehicle_id: str
    visibility: str
    unseen_s: float
    track_id: int
    fate: str

    @property
    def missed(self) -> bool:
        """Whether the driver fails to brake."""
        return self.kind == "missed"

    @property
    def weight(self) -> float:
        """How bad it is: the difference where it is largest times how long it lasts, m/s."""
        return abs(self.truth_mps2 - self.tracks_mps2) * self.duration_s

    @property
    def subject(self) -> Subject:
        """What its pictures are about."""
        return Subject(self.vehicle_id, self.track_id, with_ego=True)

    def sentence(self) -> str:
        """Return a sentence on what happened."""
        track = f"track {self.track_id}" if self.track_id >= 0 else "its track"
        why = (WHY_MISSED if self.missed else WHY_PHANTOM)[self.fate].format(track=track, vehicle=self.vehicle_id)
        demands = (
            f"{self.truth_mps2:.1f} m/s² by the truth and {self.tracks_mps2:.1f} m/s² by the tracks, "
            f"for {self.duration_s:.1f} s"
        )
        if self.missed:
            return f"Missed braking for {self.vehicle_id or 'a vehicle'}, {self._sight()}: {demands}; {why}."
        whom = f", {self.vehicle_id} being {self._sight()}" if self.vehicle_id else ""
        return f"Phantom braking: {demands}; {why}{whom}."

    def _sight(self) -> str:
        """Return a phrase on how well the sensor saw the vehicle."""
        if not np.isfinite(self.unseen_s):
            return "never detected"
        if self.unseen_s > UNSEEN_S:
            return f"unseen for {self.unseen_s:.1f} s"
        return {"visible": "in view", "partial": "partly hidden"}.get(self.visibility, "just hidden")


def worst_brakings(brakings: pd.DataFrame, count: int = WORST) -> list[Braking]:
    """Return the worst: those whose greatest difference, times how long they last, is largest."""
    texts = {"kind": object, "vehicle_id": object, "visibility": object, "fate": object}
    found = [
        Braking(**{column.name: record[column.name] for column in fields(Braking)})
        for record in brakings.astype(texts).to_dict("records")
    ]
    return sorted(found, key=lambda braking: -braking.weight)[:count]


def draw_decisions(run: RecordedRun, brakings: Sequence[Braking], folder: Path) -> list[Path]:
    """Write ``decision-1.png`` and so on, one strip for each braking, in place of an earlier report's."""
    return save_strips((decision_figure(run, braking) for braking in brakings), folder, GALLERY)


def decision_figure(run: RecordedRun, braking: Braking) -> Figure:
    """Return three pictures of a braking, and below them what the driver demands by the truth and by the tracks."""
    low, high = across(run.road)
    panel_height_in = PANEL_WIDTH_IN * (high - low + 2.0 * MARGIN_M) / (2.0 * HALF_WINDOW_M)
    width_in = PANELS * (PANEL_WIDTH_IN + GAP_IN) + GAP_IN
    height_in = HEAD_IN + panel_height_in + ROW_IN + CURVE_IN + FOOT_IN
    figure = Figure(figsize=(width_in, height_in), dpi=110)

    def place(column: int, bottom_in: float, columns: float, rows_in: float) -> tuple[float, float, float, float]:
        left = (GAP_IN + column * (PANEL_WIDTH_IN + GAP_IN)) / width_in
        return left, bottom_in / height_in, columns * PANEL_WIDTH_IN / width_in, rows_in / height_in

    above_in = height_in - HEAD_IN - panel_height_in
    for column, (step, heading) in enumerate(_moments(run, braking)):
        axes = figure.add_axes(place(column, above_in, 1.0, panel_height_in))
        axes.set_title(heading, fontsize=9.5, pad=4)
        words = draw_moment(axes, run, braking.subject, step) + _speed_words(run, braking.subject, step)
        axes.set_xlabel(words, fontsize=8.5, color="#333333", labelpad=3)
    draw_scale(figure.axes[0])
    left, bottom, wide, tall = place(0, FOOT_IN, 2.0, CURVE_IN)
    margin = 0.55 / width_in
    _draw_curves(figure.add_axes((left + margin, bottom, wide - margin, tall)), run, braking)
    figure.text(GAP_IN / width_in, 1.0 - 0.09 / height_in, braking.sentence(), fontsize=10.5, va="top")
    corner = place(2, FOOT_IN, 1.0, CURVE_IN)
    figure.text(
        corner[0] + 0.1 / width_in, corner[1] + corner[3], "\n".join((direction_words(run.road), *KEY)),
        fontsize=9, color="#444444", va="top", linespacing=1.5,
    )  # fmt: skip
    return figure


def _moments(run: RecordedRun, braking: Braking) -> list[tuple[int, str]]:
    """Return the steps that are drawn, with their headings."""
    times = run.truth.drop_duplicates("step").set_index("step")["time_s"]
    steps = {"begins": braking.from_step, "differ most": braking.step, "ends": braking.to_step}
    return [(step, f"{name}, {times[step]:.1f} s") for name, step in steps.items()]


def _speed_words(run: RecordedRun, subject: Subject, step: int) -> str:
    """Return a phrase on the speed error of the subject's track; empty where it is unknown."""
    vehicle, track = rows_at(run.truth, step), rows_at(run.tracks, step)
    true = floats(vehicle, "speed_mps")[vehicle["vehicle_id"].to_numpy() == subject.vehicle_id]
    held = floats(track, "speed_mps")[track["track_id"].to_numpy() == subject.track_id]
    if not len(true) or not len(held):
        return ""
    off = float(held[0] - true[0])
    return f", {abs(off):.1f} m/s too {'fast' if off > 0.0 else 'slow'}"


def _draw_curves(axes: Axes, run: RecordedRun, braking: Braking) -> None:
    """Draw what the driver demands over time by truth and by tracks."""
    rules, commands = ScoringSettings(), run.commands
    if commands is None:
        raise ValueError("a run without commands has no brakings")
    steps, times, episode = commands["step"].to_numpy(), floats(commands, "time_s"), commands["episode"].to_numpy()
    first, last = np.searchsorted(steps, (braking.from_step, braking.to_step))
    begin_s, end_s = times[first], times[last]
    near = (times >= begin_s - AROUND_S) & (times <= end_s + AROUND_S) & (episode == episode[first])
    shown, time_s = commands[near], times[near]
    axes.axvspan(begin_s, end_s, color="#f0e442", alpha=0.35, lw=0, zorder=0)
    for limit in (rules.brakes_mps2, rules.rolls_mps2):
        axes.axhline(limit, color="#888888", lw=0.8, ls=":", zorder=1)
    axes.plot(time_s, floats(shown, "truth_mps2"), color="black", lw=1.6, label="by the truth")
    axes.plot(time_s, floats(shown, "tracks_mps2"), color=PURPLE, lw=1.6, ls="--", label="by the tracks")
    axes.set_xlim(time_s[0], time_s[-1])
    axes.set_ylabel("driver demands, m/s²", fontsize=8.5)
    axes.set_xlabel("time, s", fontsize=8.5, labelpad=1)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, borderaxespad=0.0)
