"""One moment of a run from above: the visible ground, and the vehicles and tracks around one of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, PolyCollection

from harness.common.palette import ELLIPSE_SCALE, PURPLE
from harness.report.scene import (
    OUT_OF_SIGHT,
    SEEN_GROUND,
    SHADOW,
    VEHICLE_STYLES,
    corners,
    draw_network,
    shadow_outlines,
    view_outline,
)
from harness.running.finished import RecordedRun
from harness.running.recorder import detections_of, frame_of
from harness.storage.schema import VISIBILITY_STATES
from harness.storage.tables import floats
from mmpf.map.road import Road
from mmpf.scan import EgoPose

HALF_WINDOW_M, HALF_WIDTH_M = 27.0, 1.0
MARGIN_M = 1.2
LIGHT_PURPLE, UNSEEN_SUBJECT = "#c9a3b5", "#f7cfb8"
DRIVING_RIGHT, NORTH_UP = "driving direction →", "north is up"


@dataclass(frozen=True)
class Subject:
    """What pictures are about: a vehicle, empty where a track is of nobody, and a track, -1 for none.

    ``with_ego`` says whether the picture is moved towards the ego as far as the subject stays in it.
    """

    vehicle_id: str
    track_id: int
    with_ego: bool = False


def across(road: Road, middle_m: float = 0.0) -> tuple[float, float]:
    """Return how far a picture reaches across the road; in the plane, below and above its middle."""
    return road.across_m((-np.inf, np.inf), middle_m, HALF_WINDOW_M)


def direction_words(road: Road) -> str:
    """Return which way pictures are turned."""
    return NORTH_UP if road.has_headings else DRIVING_RIGHT


def draw_moment(axes: Axes, run: RecordedRun, subject: Subject, step: int) -> str:
    """Draw one picture into empty axes and return a line about the subject's track."""
    truth, tracks = rows_at(run.truth, step), rows_at(run.tracks, step)
    lon, lat = floats(truth, "lon_m"), floats(truth, "lat_m")
    ego = int(np.flatnonzero(truth["is_ego"].to_numpy())[0])
    rows = np.flatnonzero(truth["vehicle_id"].to_numpy() == subject.vehicle_id)
    place = (lon[rows[0]], lat[rows[0]]) if len(rows) else _place_of_track(tracks, subject.track_id)
    if place is None:
        place = float(lon[ego]), float(lat[ego])
    centre, middle = float(place[0]), float(place[1])
    if subject.with_ego:
        centre, middle = _towards(centre, float(lon[ego])), _towards(middle, float(lat[ego]))
    low, high = across(run.road, middle)
    # Beside the main lanes, for example on a ramp, the picture goes along.
    aside = min(middle - HALF_WIDTH_M - low, 0.0) + max(middle + HALF_WIDTH_M - high, 0.0)
    limits = low + aside - MARGIN_M, high + aside + MARGIN_M
    axes.set(xlim=(-HALF_WINDOW_M, HALF_WINDOW_M), ylim=limits, xticks=[], yticks=[])
    axes.set_facecolor(OUT_OF_SIGHT)
    axes.spines[:].set_color("#bbbbbb")
    detections = rows_at(run.detections, step)
    _draw_ground(axes, run, frame_of(truth).ego_pose, detections, centre)
    _draw_vehicles(axes, truth, int(rows[0]) if len(rows) else None, ego, centre)
    axes.plot(
        floats(detections, "lon_m") - centre, floats(detections, "lat_m"), "x", color="black", ms=5, mew=1.2, zorder=6
    )
    vehicle = (float(place[0]), float(place[1])) if len(rows) else None
    line = _draw_tracks(axes, tracks, subject.track_id, vehicle, centre)
    _point_to_ego(axes, float(lon[ego]) - centre)
    return line


def _towards(place: float, ego: float) -> float:
    """Return the middle between two places, but no farther from the first than keeps it well in the picture."""
    return place + float(np.clip(0.5 * (ego - place), -HALF_WINDOW_M + 8.0, HALF_WINDOW_M - 8.0))


def _place_of_track(tracks: pd.DataFrame, track_id: int) -> tuple[float, float] | None:
    own = tracks[tracks["track_id"] == track_id]
    return (float(own["lon_m"].iloc[0]), float(own["lat_m"].iloc[0])) if len(own) else None


def _draw_ground(axes: Axes, run: RecordedRun, pose: EgoPose, detections: pd.DataFrame, centre: float) -> None:
    range_m = run.sensor.range_m
    rim = view_outline(pose, run.road, range_m, centre)
    shadows = shadow_outlines(detections_of(detections), pose, run.road, range_m, centre)
    for outlines, colour, height in (([rim], SEEN_GROUND, 0), (shadows, SHADOW, 1)):
        axes.add_collection(
            PolyCollection(list(outlines), facecolor=colour, edgecolor="none", zorder=height), autolim=False
        )
    draw_network(axes, run.road, centre)
    for outline in run.ramps:
        axes.plot(outline[:, 0] - centre, outline[:, 1], color="#9a9a9a", lw=0.8, zorder=2)
    lines = {(side, lane.start_m, lane.end_m) for lane in run.road.lanes for side in (lane.right_m, lane.left_m)}
    for side, start, end in lines:
        visible = np.clip([start - centre, end - centre], -HALF_WINDOW_M, HALF_WINDOW_M)
        axes.plot(visible, [side, side], color="#9a9a9a", lw=0.8, zorder=2)


def _draw_vehicles(axes: Axes, truth: pd.DataFrame, subject: int | None, ego: int, centre: float) -> None:
    boxes = corners(truth) - np.array([centre, 0.0])
    states = truth["state"].to_numpy(dtype=object)
    near = np.abs(floats(truth, "lon_m") - centre) < HALF_WINDOW_M + 15.0
    others = near & (np.arange(len(truth)) != ego)
    for code, state in enumerate(VISIBILITY_STATES):
        chosen = others & (states == state)
        axes.add_collection(PolyCollection(list(boxes[chosen]), zorder=5, **VEHICLE_STYLES[code]), autolim=False)
    axes.add_collection(PolyCollection([boxes[ego]], facecolor="black", edgecolor="none", zorder=5), autolim=False)
    if subject is not None:
        tint = UNSEEN_SUBJECT if states[subject] == "hidden" else "none"
        axes.add_collection(PolyCollection([boxes[subject]], facecolor=tint, edgecolor="black", lw=2.2, zorder=5.5))
    if near[ego]:
        x, y = boxes[ego].mean(axis=0)
        axes.text(x, y, "ego", color="white", size=6, ha="center", va="center", zorder=8, clip_on=True)


def _draw_tracks(
    axes: Axes, tracks: pd.DataFrame, track_id: int, vehicle: tuple[float, float] | None, centre: float
) -> str:
    """Draw the tracks, the subject's own in bold, and say how far that one is from the vehicle."""
    reported = tracks[tracks["state"] != "tentative"]
    own = (reported["track_id"] == track_id).to_numpy()
    hidden = (reported["state"] == "hidden").to_numpy()
    centres = np.stack([floats(reported, "lon_m") - centre, floats(reported, "lat_m")], axis=-1)
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
    if vehicle is not None:
        axes.plot([vehicle[0] - centre, x], [vehicle[1], y], color=PURPLE, lw=1.0, ls=":", zorder=9)
    top = min(y + max(1.2, 0.5 * sizes[1, own][0]), axes.get_ylim()[1] - 1.6)
    axes.text(
        x, top, str(track_id), color=PURPLE, size=8.5, weight="bold", ha="center", va="bottom", zorder=10, clip_on=True
    )
    if vehicle is None:
        return f"track {track_id} follows no vehicle"
    return f"track {track_id}: {np.hypot(x + centre - vehicle[0], y - vehicle[1]):.1f} m off"


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


def draw_scale(axes: Axes) -> None:
    """Draw how long ten metres are."""
    left, bottom = -HALF_WINDOW_M + 1.5, axes.get_ylim()[0] + 0.8
    axes.plot([left, left + 10.0], [bottom, bottom], color="black", lw=1.5, zorder=11)
    axes.text(left + 11.0, bottom, "10 m", size=7.5, va="center", zorder=11,
              bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0})  # fmt: skip


def rows_at(table: pd.DataFrame, step: int) -> pd.DataFrame:
    """Return the rows of a step of a table that is sorted by step."""
    steps = table["step"].to_numpy()
    return table.iloc[np.searchsorted(steps, step) : np.searchsorted(steps, step, side="right")]
