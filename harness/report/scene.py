"""The road from above at one moment: vehicles, what the sensor sees, and tracks."""

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import matplotlib.patheffects as path_effects
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Patch, Polygon, Rectangle
from matplotlib.ticker import FixedLocator, FuncFormatter

from harness.common.palette import BLUE, ELLIPSE_SCALE, GREEN, ORANGE, PURPLE, VERMILION
from harness.sensor.observation import Observation
from harness.sensor.shadows import sensor_position, shadow_polygons
from harness.storage.schema import HIDDEN, OUT, PARTIAL, VISIBLE
from harness.truth.frame import Frame
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, wrapped
from mmpf.scan import Detections, EgoPose
from mmpf.tracks import HIDDEN as TRACK_HIDDEN
from mmpf.tracks import TENTATIVE, Tracks

OUT_OF_SIGHT, SEEN_GROUND, SHADOW = "#efece6", "#ffffff", "#d9d9d9"
VEHICLE_STYLES: dict[int, dict[str, Any]] = {
    VISIBLE: {"facecolor": GREEN, "edgecolor": "none", "label": "vehicle: visible"},
    PARTIAL: {"facecolor": ORANGE, "edgecolor": "none", "label": "vehicle: partly hidden"},
    HIDDEN: {"facecolor": "none", "edgecolor": VERMILION, "linewidth": 1.3, "label": "vehicle: hidden"},
    OUT: {"facecolor": "none", "edgecolor": "#9a9a9a", "linewidth": 0.8, "label": "vehicle: out of range"},
}
WALL_STYLE: dict[str, Any] = {"color": "#4a4038", "lw": 2.0}
MARGIN_M, NUMBER_POINTS = 2.5, 7.5
TITLE_CHARACTERS_PER_IN = 10.0
BEARINGS = 720


@dataclass(frozen=True)
class PictureScene:
    """One moment on the road: truth, what the sensor made of it, and the tracker of that, and the sensor's range.

    ``particles`` are the longitudinal and lateral positions, shape (2, n); None of a tracker without any. The vehicle
    ``named`` is written at its place; empty for none. ``across_m`` are the lowest and highest lateral position that are
    drawn; None for those of the lanes in range, in the plane of all that is.
    """

    frame: Frame
    observation: Observation
    tracks: Tracks
    road: Road
    range_m: float
    particles: FloatArray | None = None
    named: str = ""
    across_m: tuple[float, float] | None = None

    @property
    def origin_m(self) -> float:
        """The ego's longitudinal position, which is drawn at zero."""
        return float(self.frame.lon_m[self.frame.ego])


def scene_figure(scene: PictureScene, title: str = "") -> Figure:
    """Return a figure of the whole range: of a single road what lies ahead of the ego above, what lies behind below."""
    if isinstance(scene.road, LaneGraphRoad):
        return _plane_figure(scene, title)
    low, high = _road_edges(scene)
    overlap, range_m = 8.0, scene.range_m
    windows = ((-overlap, range_m + MARGIN_M), (-range_m - MARGIN_M, overlap))
    width_in = 10.5
    strip_in = width_in * (high - low + 2 * MARGIN_M) / (range_m + overlap + MARGIN_M)
    figure = Figure(figsize=(width_in, 2 * strip_in + 2.2), dpi=150, layout="constrained")
    for axes, window, name in zip(figure.subplots(2, 1), windows, ("ahead", "behind"), strict=True):
        draw_scene(axes, scene, window)
        axes.set_title(name, loc="left", fontsize=9, color="#555555", pad=3)
    figure.axes[0].set_xlabel("")
    return _explained(figure, scene, title, 5)


def _plane_figure(scene: PictureScene, title: str) -> Figure:
    """Return a network of many roads, north up."""
    figure = Figure(figsize=(9.0, 9.8), dpi=120, layout="constrained")
    axes = figure.subplots()
    draw_scene(axes, scene, (-scene.range_m - MARGIN_M, scene.range_m + MARGIN_M))
    north = float(scene.frame.lat_m[scene.frame.ego])
    axes.yaxis.set_major_locator(FixedLocator(list(north + axes.get_xticks())))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y - north:.0f}".replace("-", "\N{MINUS SIGN}")))
    axes.set(xlabel="metres east of the ego", ylabel="metres north of the ego", ylim=_road_edges(scene))
    return _explained(figure, scene, title, 4)


def _explained(figure: Figure, scene: PictureScene, title: str, columns: int) -> Figure:
    """Return the figure with its title above and a legend below."""
    lines = textwrap.fill(title, int(TITLE_CHARACTERS_PER_IN * figure.get_figwidth()))
    figure.suptitle(lines, x=0.01, ha="left", fontsize=12)
    entries = legend_entries(scene.particles is not None, len(scene.road.walls_near(0.0, 0.0, np.inf)) > 0)
    figure.legend(handles=entries, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def draw_scene(axes: Axes, scene: PictureScene, window: tuple[float, float]) -> None:
    """Draw a stretch of the road, metres relative to the ego, into the axes."""
    origin, detections = scene.origin_m, scene.observation.scan.detections
    _draw_ground(axes, scene.observation, scene.road, scene.range_m, origin)
    _draw_lanes(axes, scene.road, origin, window)
    if scene.particles is not None:
        lon_m, lat_m = scene.particles
        axes.plot(lon_m - origin, lat_m, ".", color=BLUE, ms=1.6, mew=0, alpha=0.45, zorder=5.5, rasterized=True)
    _draw_vehicles(axes, scene.frame, scene.observation, origin)
    for i in np.flatnonzero(scene.frame.vehicle_id == scene.named):
        below = scene.frame.lon_m[i] - origin, scene.frame.lat_m[i] - 0.5 * scene.frame.width_m[i]
        _write(axes, scene.named, below, 2.5, {"size": 9, "weight": "bold", "va": "top"})
    axes.plot(detections.lon_m - origin, detections.lat_m, "x", color="black", ms=5, mew=1.2, zorder=6)
    _draw_tracks(axes, scene.tracks, origin, window)
    low, high = _road_edges(scene)
    axes.set(xlim=window, ylim=(low - MARGIN_M, high + MARGIN_M), aspect="equal")
    axes.set(xlabel="metres ahead of the ego", ylabel="lateral position (m)")
    axes.spines[:].set_visible(False)
    axes.tick_params(length=2, color="#999999")


def legend_entries(with_particles: bool, with_walls: bool) -> list[Patch | Line2D]:
    """Return one entry for each kind of thing that ``draw_scene`` draws."""
    entries: list[Patch | Line2D] = [Patch(facecolor="black", label="ego, has the sensor")]
    entries += [Patch(**style) for style in VEHICLE_STYLES.values()]
    entries += [
        Patch(facecolor=SHADOW, label="hidden area"),
        Patch(facecolor=OUT_OF_SIGHT, label="beyond the range"),
        Line2D([], [], ls="none", marker="x", color="black", ms=6, mew=1.2, label="detection"),
        Line2D([], [], color=PURPLE, lw=1.4, label="track, 95 % ellipse"),
        Line2D([], [], color=PURPLE, lw=1.4, ls=(0, (3, 2)), label="track taken for hidden"),
    ]
    entries += [Line2D([], [], label="wall of a building", **WALL_STYLE)] if with_walls else []
    if with_particles:
        entries.append(Line2D([], [], ls="none", marker="o", color=BLUE, ms=2.5, alpha=0.6, label="particles"))
    return entries


def _road_edges(scene: PictureScene) -> tuple[float, float]:
    if scene.across_m is not None:
        return scene.across_m
    within = scene.origin_m - scene.range_m, scene.origin_m + scene.range_m
    return scene.road.across_m(within, float(scene.frame.lat_m[scene.frame.ego]), scene.range_m)


def _draw_ground(axes: Axes, observation: Observation, road: Road, range_m: float, origin: float) -> None:
    """Draw what the sensor can reach and, in it, what it cannot see."""
    ego, detections = observation.scan.ego, observation.scan.detections
    axes.set_facecolor(OUT_OF_SIGHT)
    reach = np.full(BEARINGS, range_m)
    if observation.scan.free_space is not None:
        reach = np.where(observation.scan.free_space.range_m > 0.0, range_m, 0.0)
    rim = view_outline(ego, road, reach, origin)
    axes.add_patch(Polygon(rim, facecolor=SEEN_GROUND, edgecolor="none", zorder=0))
    shadows = shadow_outlines(detections, ego, road, range_m, origin)
    axes.add_collection(PolyCollection(shadows, facecolor=SHADOW, edgecolor="none", zorder=1), autolim=False)


def view_outline(ego: EgoPose, road: Road, reach_m: FloatArray, origin: float) -> FloatArray:
    """Return the rim of what the sensor reaches, shape (n,) by bearing, in the road frame from the origin, (k, 2)."""
    bearings = -np.pi + 2.0 * np.pi / len(reach_m) * (np.arange(len(reach_m)) + 0.5)
    rim = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1) * reach_m[:, None] + sensor_position(ego, road)
    return in_road_frame(rim, road, origin)


def shadow_outlines(
    detections: Detections, ego: EgoPose, road: Road, range_m: float, origin: float
) -> list[FloatArray]:
    """Return the outlines of shadows, walls' too, in the road frame relative to the origin, each of shape (k, 2)."""
    shadows = [*shadow_polygons(detections, ego, road, range_m), *_wall_shadows(ego, road, range_m)]
    return [in_road_frame(outline, road, origin) for outline in shadows]


def _wall_shadows(ego: EgoPose, road: Road, range_m: float) -> Iterator[FloatArray]:
    """Yield what each wall hides within the sensor's range: from the wall to the arc behind it, in the plane."""
    sensor = np.array(sensor_position(ego, road))
    reach = shapely.Point(sensor).buffer(range_m, quad_segs=90)
    for wall in road.walls_near(float(sensor[0]), float(sensor[1]), range_m):
        ends = shapely.get_coordinates(shapely.LineString(wall.reshape(2, 2)).intersection(reach)) - sensor
        if len(ends) != 2:
            continue
        first, last = np.arctan2(ends[:, 1], ends[:, 0])
        swept = wrapped(first - last)
        arc = last + swept * np.linspace(0.0, 1.0, 25)
        yield sensor + np.concatenate([ends, range_m * np.stack([np.cos(arc), np.sin(arc)], axis=-1)])


def in_road_frame(outline: FloatArray, road: Road, origin: float) -> FloatArray:
    """Return a Cartesian outline, shape (k, 2), in the road frame relative to the origin; straight edges may bend."""
    if not road.is_straight:
        outline = shapely.get_coordinates(shapely.segmentize(shapely.Polygon(outline), 2.0))
    lon, lat = road.to_road(outline[:, 0], outline[:, 1])
    return np.stack([lon - origin, lat], axis=-1)


def _draw_lanes(axes: Axes, road: Road, origin: float, window: tuple[float, float]) -> None:
    """Draw each lane's two lines, dashed where the next lane begins, solid at the road's edge; in the plane walls too.

    Of a network in the plane no path across a junction is drawn.
    """
    for line in road.lines():
        for side in () if line.in_junction else (0.5, -0.5):
            edge = shapely.get_coordinates(shapely.offset_curve(shapely.LineString(line.xy), side * line.width_m))
            if len(edge):
                axes.plot(edge[:, 0] - origin, edge[:, 1], color="#8c8c8c", lw=0.6, zorder=2)
    for wall in road.walls_near(0.0, 0.0, np.inf):
        axes.plot(wall[[0, 2]] - origin, wall[[1, 3]], **WALL_STYLE, zorder=3)
    for lat, start, end in ((lat, ln.start_m, ln.end_m) for ln in road.lanes for lat in (ln.right_m, ln.left_m)):
        lon = np.clip(np.array([start - origin, end - origin]), *window)
        cuts = np.unique(np.concatenate([lon, [s - origin for ln in road.lanes for s in (ln.start_m, ln.end_m)]]))
        cuts = cuts[(cuts >= lon[0]) & (cuts <= lon[1])]
        for begin, finish in pairwise(cuts):
            middle = np.full(2, 0.5 * (begin + finish) + origin)
            both_sides = road.on_a_lane(middle, lat + np.array([-0.5, 0.5]))
            style: Any = (0, (6, 8)) if both_sides.all() else "solid"
            axes.plot([begin, finish], [lat, lat], color="#8c8c8c", lw=0.9, ls=style, zorder=2)


def _draw_vehicles(axes: Axes, frame: Frame, observation: Observation, origin: float) -> None:
    patches = []
    for i in range(len(frame)):
        length, width = frame.length_m[i], frame.width_m[i]
        corner = (frame.lon_m[i] - origin - length / 2, frame.lat_m[i] - width / 2)
        style = {"facecolor": "black", "edgecolor": "none"} if i == frame.ego else VEHICLE_STYLES[observation.state[i]]
        angle = np.rad2deg(frame.heading_rad[i])
        patches.append(Rectangle(corner, length, width, angle=angle, rotation_point="center", **style))
    axes.add_collection(PatchCollection(patches, match_original=True, zorder=5), autolim=False)
    axes.text(0.0, frame.lat_m[frame.ego], "ego", color="white", size=7, ha="center", va="center", zorder=7)


def _draw_tracks(axes: Axes, tracks: Tracks, origin: float, window: tuple[float, float]) -> None:
    """Draw the reported tracks, each with its number above or below it, where no other number stands."""
    m_per_point = (window[1] - window[0]) / (72.0 * axes.figure.bbox.width / axes.figure.dpi)
    written: list[tuple[float, float, float]] = []
    for i in np.flatnonzero(tracks.state != TENTATIVE):
        x, y = tracks.lon_m[i] - origin, tracks.lat_m[i]
        if not window[0] <= x <= window[1]:
            continue
        style: Any = (0, (3, 2)) if tracks.state[i] == TRACK_HIDDEN else "solid"
        long, wide = (2.0 * ELLIPSE_SCALE * std_m[i] for std_m in (tracks.std_lon_m, tracks.std_lat_m))
        axes.add_patch(Ellipse((x, y), long, wide, fc="none", ec=PURPLE, lw=1.4, ls=style, zorder=8))
        number, high = str(tracks.track_id[i]), NUMBER_POINTS * m_per_point
        half, away = 0.32 * len(number) * high, min(max(1.0, 0.5 * wide), 1.6) + 0.5 * high
        for place in ((x, y + away), (x, y - away)):
            if all(abs(place[0] - u) >= half + other or abs(place[1] - v) >= high for u, v, other in written):
                _write(axes, number, place, 2.0, {"color": PURPLE, "size": NUMBER_POINTS, "va": "center"})
                written.append((*place, half))
                break


def _write(axes: Axes, text: str, place: tuple[float, float], halo: float, style: dict[str, Any]) -> None:
    """Write on the road, with a white halo of so many points."""
    effects = [path_effects.withStroke(linewidth=halo, foreground="white")]
    axes.annotate(text, place, ha="center", path_effects=effects, zorder=9, annotation_clip=True, **style)
