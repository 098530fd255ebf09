"""The failure gallery: a run's worst occlusion events, each as a strip of pictures of the road from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, PolyCollection
from matplotlib.figure import Figure

from harness.report.finished import RecordedRun
from harness.report.scene import (
    ELLIPSE_SCALE,
    OUT_OF_SIGHT,
    PURPLE,
    SEEN_GROUND,
    SHADOW,
    VEHICLE_STYLES,
    corners,
    draw_network,
    shadow_outlines,
    view_outline,
)
from harness.runfolder.tables import detections_of, floats, frame_of
from harness.scoring.settings import ScoringSettings
from harness.sensor.observation import VISIBILITY_STATES
from harness.writing.files import save_figure
from mmpf.road import Road
from mmpf.scan import EgoPose

WORST = 5
GALLERY = "gallery-[0-9].png"
HALF_WINDOW_M = 27.0
MARGIN_M = 1.2
COLUMNS, PANEL_WIDTH_IN = 3, 4.0
HEAD_IN, ROW_IN, FOOT_IN, GAP_IN = 0.56, 0.56, 0.3, 0.12
"""Above the first row, between two rows, below the last, and at the sides of each picture."""
LIGHT_PURPLE, UNSEEN_SUBJECT = "#c9a3b5", "#f7cfb8"
DRIVING_RIGHT, NORTH_UP = "driving direction →", "north is up"
KEY = (
    "thick box: the vehicle",
    "bold ellipse: the track that held it, 95 %,",
    "    dashed while the tracker takes it for hidden",
    "thin ellipses: other tracks; crosses: detections",
    "grey: the sensor's shadows",
)
EVENT_COLUMNS = ("vehicle_id", "track_id", "outcome", "from_step", "to_step", "duration_s")
SEVERITY = {"lost": 0, "hijacked": 0, "survived": 1, "same_id": 2}


@dataclass(frozen=True)
class OcclusionEvent:
    """One time that a tracked vehicle was hidden and came back.

    Attributes:
        vehicle_id: The vehicle.
        track_id: The track that held it before, -1 if none.
        outcome: ``lost``, ``hijacked``, ``survived`` (alive, but not on the vehicle) or ``same_id``.
        from_step: Step of the last detection before.
        to_step: Step of the first detection after.
        duration_s: Time between the two.
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
        """Return what happened, in words."""
        kept = f"track {self.track_id}" if self.track_id >= 0 else "no track"
        ends = {
            "lost": f"{kept} was given up before it could be put back on the vehicle",
            "hijacked": f"{kept} sat on another vehicle afterwards",
            "survived": f"{kept} lived on, but not on this vehicle",
            "same_id": f"{kept} followed it again afterwards",
        }
        error = f", at most {self.largest_error_m:.1f} m off while hidden" if np.isfinite(self.largest_error_m) else ""
        return f"{self.vehicle_id}, unseen for {self.duration_s:.1f} s: {ends[self.outcome]}{error}."


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


def draw_gallery(run: RecordedRun, events: Sequence[OcclusionEvent], folder: Path) -> list[Path]:
    """Write ``gallery-1.png`` and so on, one strip for each event, in place of an earlier report's."""
    paths = []
    for number, event in enumerate(events, start=1):
        paths.append(folder / f"gallery-{number}.png")
        save_figure(strip_figure(run, event), paths[-1])
    for stale in set(folder.glob(GALLERY)) - set(paths):
        stale.unlink()
    return paths


def strip_figure(run: RecordedRun, event: OcclusionEvent) -> Figure:
    """Return five pictures of an event, driving direction to the right as in the replay, the vehicle in the middle."""
    moments = _moments(run, event)
    low, high = _across(run.road)
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
        axes.set(xlim=(-HALF_WINDOW_M, HALF_WINDOW_M), ylim=(low - MARGIN_M, high + MARGIN_M), xticks=[], yticks=[])
        axes.set_facecolor(OUT_OF_SIGHT)
        axes.spines[:].set_color("#bbbbbb")
        axes.set_title(heading, fontsize=9.5, pad=4)
        axes.set_xlabel(_draw_moment(axes, run, event, step), fontsize=8.5, color="#333333", labelpad=3)
        if run.road.graph is not None:
            middle = _place_of(run, event.vehicle_id, step)
            axes.set_ylim(middle + low - MARGIN_M, middle + high + MARGIN_M)
    figure.text(GAP_IN / width_in, 1.0 - 0.09 / height_in, event.sentence(), fontsize=10.5, va="top")
    left, bottom = corner(len(moments))
    top = bottom + panel_height_in / height_in
    key = (NORTH_UP if run.road.graph is not None else DRIVING_RIGHT, *KEY)
    figure.text(left + 0.1 / width_in, top, "\n".join(key), fontsize=9, color="#444444", va="top", linespacing=1.5)
    _draw_scale(figure.axes[0])
    return figure


def _across(road: Road) -> tuple[float, float]:
    """Return how far a picture reaches across the road; in the plane, below and above the vehicle."""
    if road.graph is not None:
        return -HALF_WINDOW_M, HALF_WINDOW_M
    return min(lane.right_m for lane in road.lanes), max(lane.left_m for lane in road.lanes)


def _place_of(run: RecordedRun, vehicle_id: str, step: int) -> float:
    truth = _rows_at(run.truth, step)
    return float(floats(truth, "lat_m")[truth["vehicle_id"].to_numpy() == vehicle_id][0])


def _moments(run: RecordedRun, event: OcclusionEvent) -> list[tuple[int, str]]:
    """Return the steps that are drawn, with their headings; the last is when the outcome is judged."""
    steps, first = np.unique(run.truth["step"].to_numpy(dtype=np.int64), return_index=True)
    times, episodes = floats(run.truth, "time_s")[first], run.truth["episode"].to_numpy(dtype=np.int64)[first]
    at = {int(step): float(time) for step, time in zip(steps, times, strict=True)}
    start_s, end_s = at[event.from_step], at[event.to_step]
    same_ego = episodes == episodes[np.searchsorted(steps, event.to_step)]
    judged_s = min(end_s + ScoringSettings().event_judged_s, float(times[same_ego].max()))

    def nearest(time_s: float) -> int:
        return int(steps[np.argmin(np.abs(times - time_s))])

    chosen = [(event.from_step, f"last seen, {start_s:.1f} s")]
    for share in (1.0 / 3.0, 2.0 / 3.0):
        step = nearest(start_s + share * (end_s - start_s))
        chosen.append((step, f"unseen for {at[step] - start_s:.1f} s"))
    chosen.append((event.to_step, f"seen again, {end_s:.1f} s"))
    chosen.append((nearest(judged_s), f"{judged_s - end_s:.1f} s later"))
    return chosen


def _draw_moment(axes: Axes, run: RecordedRun, event: OcclusionEvent, step: int) -> str:
    """Draw one picture and return a line about the event's track."""
    truth = _rows_at(run.truth, step)
    lon, lat = floats(truth, "lon_m"), floats(truth, "lat_m")
    subject = int(np.flatnonzero(truth["vehicle_id"].to_numpy() == event.vehicle_id)[0])
    ego = int(np.flatnonzero(truth["is_ego"].to_numpy())[0])
    centre = float(lon[subject])
    detections = _rows_at(run.detections, step)
    _draw_ground(axes, run, frame_of(truth).ego_pose, detections, centre)
    _draw_vehicles(axes, truth, subject, ego, centre)
    axes.plot(
        floats(detections, "lon_m") - centre, floats(detections, "lat_m"), "x", color="black", ms=5, mew=1.2, zorder=6
    )
    line = _draw_tracks(axes, _rows_at(run.tracks, step), event.track_id, (float(lon[subject]), float(lat[subject])))
    _point_to_ego(axes, float(lon[ego]) - centre)
    return line


def _draw_ground(axes: Axes, run: RecordedRun, pose: EgoPose, detections: pd.DataFrame, centre: float) -> None:
    range_m = run.sensor.range_m
    rim = view_outline(pose, run.road, range_m, centre)
    shadows = shadow_outlines(detections_of(detections), pose, run.road, range_m, centre)
    for outlines, colour, height in (([rim], SEEN_GROUND, 0), (shadows, SHADOW, 1)):
        axes.add_collection(
            PolyCollection(list(outlines), facecolor=colour, edgecolor="none", zorder=height), autolim=False
        )
    draw_network(axes, run.road, centre)
    lines = {(side, lane.start_m, lane.end_m) for lane in run.road.lanes for side in (lane.right_m, lane.left_m)}
    for side, start, end in lines:
        visible = np.clip([start - centre, end - centre], -HALF_WINDOW_M, HALF_WINDOW_M)
        axes.plot(visible, [side, side], color="#9a9a9a", lw=0.8, zorder=2)


def _draw_vehicles(axes: Axes, truth: pd.DataFrame, subject: int, ego: int, centre: float) -> None:
    boxes = corners(truth) - np.array([centre, 0.0])
    states = truth["state"].to_numpy(dtype=object)
    near = np.abs(floats(truth, "lon_m") - centre) < HALF_WINDOW_M + 15.0
    others = near & (np.arange(len(truth)) != ego)
    for code, state in enumerate(VISIBILITY_STATES):
        chosen = others & (states == state)
        axes.add_collection(PolyCollection(list(boxes[chosen]), zorder=5, **VEHICLE_STYLES[code]), autolim=False)
    axes.add_collection(PolyCollection([boxes[ego]], facecolor="black", edgecolor="none", zorder=5), autolim=False)
    tint = UNSEEN_SUBJECT if states[subject] == "hidden" else "none"
    axes.add_collection(PolyCollection([boxes[subject]], facecolor=tint, edgecolor="black", lw=2.2, zorder=5.5))
    if near[ego]:
        x, y = boxes[ego].mean(axis=0)
        axes.text(x, y, "ego", color="white", size=6, ha="center", va="center", zorder=8, clip_on=True)


def _draw_tracks(axes: Axes, tracks: pd.DataFrame, track_id: int, vehicle: tuple[float, float]) -> str:
    """Draw the tracks, the event's own in bold, and say how far that one is from the vehicle."""
    lon, lat = vehicle
    reported = tracks[tracks["state"] != "tentative"]
    own = (reported["track_id"] == track_id).to_numpy()
    hidden = (reported["state"] == "hidden").to_numpy()
    centres = np.stack([floats(reported, "lon_m") - lon, floats(reported, "lat_m")], axis=-1)
    sizes = 2.0 * ELLIPSE_SCALE * np.stack([floats(reported, "std_lon_m"), floats(reported, "std_lat_m")])
    for chosen, colour, width in ((~own, LIGHT_PURPLE, 1.2), (own, PURPLE, 2.0)):
        ellipses = EllipseCollection(
            widths=sizes[0, chosen],
            heights=sizes[1, chosen],
            angles=np.zeros(chosen.sum()),
            units="xy",
            offsets=centres[chosen],
            offset_transform=axes.transData,
            facecolor="none",
            edgecolor=colour,
            linewidth=width,
            linestyle=[(0, (3, 2)) if dashed else "solid" for dashed in hidden[chosen]],
            zorder=8,
        )
        axes.add_collection(ellipses, autolim=False)
    if not own.any():
        return f"track {track_id} is gone" if track_id >= 0 else "no track held it"
    x, y = centres[own][0]
    axes.plot([0.0, x], [lat, y], color=PURPLE, lw=1.0, ls=":", zorder=9)
    top = min(y + max(1.2, 0.5 * sizes[1, own][0]), axes.get_ylim()[1] - 1.6)
    axes.text(
        x, top, str(track_id), color=PURPLE, size=8.5, weight="bold", ha="center", va="bottom", zorder=10, clip_on=True
    )
    return f"track {track_id}: {np.hypot(x, y - lat):.1f} m off"


def _point_to_ego(axes: Axes, ahead_m: float) -> None:
    """Say where the ego is where the picture does not reach it."""
    if abs(ahead_m) < HALF_WINDOW_M:
        return
    edge = 0.985 if ahead_m > 0.0 else 0.015
    text = f"ego {ahead_m:.0f} m →" if ahead_m > 0.0 else f"← ego {-ahead_m:.0f} m"
    axes.text(
        edge, 0.5, text, transform=axes.transAxes, size=8, ha="right" if ahead_m > 0.0 else "left", va="center",
        zorder=11, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5},
    )  # fmt: skip


def _draw_scale(axes: Axes) -> None:
    left, bottom = -HALF_WINDOW_M + 1.5, axes.get_ylim()[0] + 0.8
    axes.plot([left, left + 10.0], [bottom, bottom], color="black", lw=1.5, zorder=11)
    axes.text(left + 11.0, bottom, "10 m", size=7.5, va="center", zorder=11,
              bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0})  # fmt: skip


def _rows_at(table: pd.DataFrame, step: int) -> pd.DataFrame:
    """Return the rows of a step of a table that is sorted by step."""
    steps = table["step"].to_numpy()
    return table.iloc[np.searchsorted(steps, step) : np.searchsorted(steps, step, side="right")]
