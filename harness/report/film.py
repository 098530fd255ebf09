"""A run as a film: the road from above, in two rows, ahead of and behind the ego; needs the extra ``video``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pandas as pd
from PIL import Image, ImageDraw, ImageFont

from harness.common.palette import ELLIPSE_SCALE, GREEN, ORANGE, PURPLE, VERMILION
from harness.report.run_charts import NAMES
from harness.report.scene import BEARINGS, OUT_OF_SIGHT, SEEN_GROUND, SHADOW, corners, shadow_outlines, view_outline
from harness.running.finished import RecordedRun
from harness.running.recorder import detections_of, frame_of
from harness.storage.tables import floats
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import EgoPose

WIDTH, HEIGHT = 1280, 720
# Drawn this many times larger and reduced, so that edges are smooth.
SMOOTH = 2
OVERLAP_M, MARGIN_M = 8.0, 2.5
DASH = 12.0 * SMOOTH
HEAD, FOOT, GAP = 34, 34, 14
INK = "#000000"
# Fill and edge of vehicles.
STYLES = {"visible": (GREEN, None), "partial": (ORANGE, None), "hidden": (None, VERMILION), "out": (None, "#9a9a9a")}
LEGEND = {name: STYLES[state] for state, name in NAMES.items()} | {"ego": (INK, None), "hidden area": (SHADOW, None)}


@dataclass(frozen=True)
class _PictureRow:
    """A stretch of road in the picture, which pixels are ``SMOOTH`` times the film's, from its upper left corner on."""

    draw: ImageDraw.ImageDraw
    origin_m: tuple[float, float]
    scale: float

    def place(self, lon_lat: FloatArray) -> list[tuple[float, float]]:
        """Return road-frame points, shape (n, 2), in the picture."""
        x = self.scale * (lon_lat[:, 0] - self.origin_m[0])
        y = self.scale * (self.origin_m[1] - lon_lat[:, 1])
        return list(zip(x.tolist(), y.tolist(), strict=True))


def write_film(run: RecordedRun, path: Path) -> None:
    """Write a run's pictures, one for each step, as an MP4 film in its own time."""
    times = np.unique(run.truth["time_s"].to_numpy(dtype=np.float64))
    rate = 1.0 / float(np.median(np.diff(times))) if len(times) > 1 else 10.0
    writer = imageio_ffmpeg.write_frames(str(path), (WIDTH, HEIGHT), fps=rate, output_params=["-f", "mp4"], quality=7)
    writer.send(None)
    tracks, detections = (dict(list(table.groupby("step"))) for table in (run.reported, run.detections))
    try:
        for step, truth in run.truth.groupby("step"):
            picture = draw_frame(
                run, truth, detections.get(step, run.detections[:0]), tracks.get(step, run.reported[:0])
            )
            writer.send(np.ascontiguousarray(picture))
    finally:
        writer.close()


def draw_frame(run: RecordedRun, truth: pd.DataFrame, detections: pd.DataFrame, tracks: pd.DataFrame) -> Image.Image:
    """Return the picture of one step, from its rows of each table; of tracks, from the reported ones."""
    picture = Image.new("RGB", (SMOOTH * WIDTH, SMOOTH * HEIGHT), "white")
    ego = int(np.flatnonzero(truth["is_ego"].to_numpy(dtype=bool))[0])
    pose = frame_of(truth).ego_pose
    reach = run.sensor.range_m + MARGIN_M
    low = min(lane.right_m for lane in run.road.lanes) - MARGIN_M
    high = max(lane.left_m for lane in run.road.lanes) + MARGIN_M
    half = (HEIGHT - HEAD - FOOT - GAP) // 2
    scale = SMOOTH * min(WIDTH / (reach + OVERLAP_M), half / (high - low))
    for place, start_m in enumerate((-OVERLAP_M, -reach)):
        stretch = Image.new("RGB", (SMOOTH * WIDTH, round(scale * (high - low))), OUT_OF_SIGHT)
        strip = _PictureRow(ImageDraw.Draw(stretch), (pose.lon_m + start_m, high), scale)
        _draw_ground(strip, run, pose, detections)
        _draw_road_and_vehicles(strip, run, truth, ego)
        for x, y in strip.place(detections[["lon_m", "lat_m"]].to_numpy(dtype=np.float64)):
            _draw_cross(strip.draw, x, y)
        _draw_tracks(strip, tracks, pose)
        picture.paste(stretch, (0, SMOOTH * (HEAD + place * (half + GAP))))
    rows = f"(above: {run.sensor.range_m:g} m ahead, below: behind)"
    _draw_words(ImageDraw.Draw(picture), f"{run.config.title()}: {floats(truth, 'time_s')[0]:.1f} s   {rows}")
    return picture.reduce(SMOOTH)


def _draw_ground(strip: _PictureRow, run: RecordedRun, pose: EgoPose, detections: pd.DataFrame) -> None:
    range_m = run.sensor.range_m
    strip.draw.polygon(strip.place(view_outline(pose, run.road, np.full(BEARINGS, range_m), 0.0)), fill=SEEN_GROUND)
    for outline in shadow_outlines(detections_of(detections), pose, run.road, range_m, 0.0):
        strip.draw.polygon(strip.place(outline), fill=SHADOW)


def _draw_road_and_vehicles(strip: _PictureRow, run: RecordedRun, truth: pd.DataFrame, ego: int) -> None:
    window = strip.origin_m[0] + np.array([0.0, SMOOTH * WIDTH / strip.scale])
    for lane in run.road.lanes:
        start, end = np.clip([lane.start_m, lane.end_m], *window)
        for side in (lane.right_m, lane.left_m):
            if start < end:
                strip.draw.line(strip.place(np.array([[start, side], [end, side]])), fill="#a0a0a0", width=SMOOTH)
    lon, outlines = floats(truth, "lon_m"), corners(truth)
    states = truth["state"].to_numpy(dtype=object)
    for i in np.flatnonzero((lon > window[0] - 20.0) & (lon < window[1] + 20.0)):
        fill, edge = LEGEND["ego"] if i == ego else STYLES[states[i]]
        strip.draw.polygon(strip.place(outlines[i]), fill=fill, outline=edge, width=2 * SMOOTH)


def _draw_tracks(strip: _PictureRow, tracks: pd.DataFrame, ego: EgoPose) -> None:
    """Draw ellipses, and as many of their numbers as do not overlap: those nearest to the ego first."""
    away_m = np.hypot(floats(tracks, "lon_m") - ego.lon_m, floats(tracks, "lat_m") - ego.lat_m)
    tracks = tracks.iloc[np.argsort(away_m, kind="stable")]
    sizes = ELLIPSE_SCALE * strip.scale * np.stack([floats(tracks, "std_lon_m"), floats(tracks, "std_lat_m")], axis=-1)
    places = strip.place(tracks[["lon_m", "lat_m"]].to_numpy(dtype=np.float64))
    font = ImageFont.load_default(11 * SMOOTH)
    drawn = places, sizes.tolist(), tracks["state"] == "hidden", tracks["track_id"].astype(str)
    taken = np.zeros((0, 4))
    for (x, y), (along, across), dashed, number in zip(*drawn, strict=True):
        _draw_ellipse(strip.draw, (x - along, y - across, x + along, y + across), dashed)
        above = y - min(max(across, strip.scale), 2.0 * strip.scale)
        box = np.array(strip.draw.textbbox((x, above), number, font, "mb", stroke_width=SMOOTH))
        if not ((box[:2] < taken[:, 2:]) & (taken[:, :2] < box[2:])).all(axis=1).any():
            strip.draw.text((x, above), number, PURPLE, font, "mb", stroke_width=SMOOTH, stroke_fill="white")
            taken = np.vstack([taken, box])


def _draw_cross(draw: ImageDraw.ImageDraw, x: float, y: float) -> None:
    arm = 4 * SMOOTH
    for slope in (1, -1):
        draw.line((x - arm, y - slope * arm, x + arm, y + slope * arm), fill=INK, width=SMOOTH)


def _draw_ellipse(draw: ImageDraw.ImageDraw, box: tuple[float, float, float, float], dashed: bool) -> None:
    """Draw an ellipse, whose dashes are of one length at its ends and along its sides."""
    begins, ends = np.array([0.0]), np.array([360.0])
    if dashed:
        degrees = np.linspace(0.0, 360.0, 361)
        turns, half = np.deg2rad(degrees), 0.5 * np.subtract(box[2:], box[:2])[:, None]
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(half * [np.cos(turns), np.sin(turns)]))))
        dashes = np.arange(0.0, along[-1], DASH)
        begins, ends = (np.interp(dashes + more, along, degrees) for more in (0.0, 0.6 * DASH))
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        draw.arc(box, begin, end, fill=PURPLE, width=2 * SMOOTH)


def _draw_words(draw: ImageDraw.ImageDraw, heading: str) -> None:
    draw.text((10 * SMOOTH, 8 * SMOOTH), heading, fill="#222222", font=ImageFont.load_default(16 * SMOOTH))
    font, x, y = ImageFont.load_default(14 * SMOOTH), 10.0 * SMOOTH, SMOOTH * (HEIGHT - 24)
    for name in (*LEGEND, "detection", "track, 95 % ellipse", "track taken for hidden"):
        box = x, y, x + 22 * SMOOTH, y + 13 * SMOOTH
        if name in LEGEND:
            fill, edge = LEGEND[name]
            draw.rectangle(box, fill=fill, outline=edge, width=2 * SMOOTH)
        elif name == "detection":
            _draw_cross(draw, x + 11 * SMOOTH, y + 7 * SMOOTH)
        else:
            _draw_ellipse(draw, box, name.endswith("hidden"))
        draw.text((x + 28 * SMOOTH, y - SMOOTH), name, fill="#222222", font=font)
        x += 28 * SMOOTH + draw.textlength(name, font=font) + 22 * SMOOTH
