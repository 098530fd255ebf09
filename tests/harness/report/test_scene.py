import io
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from harness.report.scene import PictureScene, draw_scene, legend_entries, scene_figure
from harness.sensor.detector import build_sensor
from harness.sensor.profiles import sensor_settings
from mmpf.map.corridor_road import CorridorRoad, highway
from mmpf.map.road import Lane
from mmpf.tracks import CONFIRMED, HIDDEN, Tracks
from tests.harness.closedloop.frames import frame_of


def jam(seed=4, count=34):
    rng = np.random.default_rng(seed)
    lane = rng.permutation(np.repeat(np.arange(5), 7))[:count]
    lon = 300.0 + np.array([np.count_nonzero(lane[:i] == lane[i]) for i in range(count)]) * 29.0 - 95.0
    lon += rng.uniform(-8, 8, count)
    ego = int(np.argmin(np.abs(lon - 300.0) + 5.0 * np.abs(lane - 2)))
    truck = rng.random(count) < 0.1
    lat, heading = (lane + 0.5) * 3.66 + rng.normal(0, 0.2, count), rng.normal(0, 0.01, count)
    size = {"length_m": np.where(truck, 14.0, 4.7), "width_m": np.where(truck, 2.5, 1.9)}
    frame = frame_of(lon, lat, np.full(count, 12.0), heading_rad=heading, lane=5 - lane, **size)
    return replace(frame, ego=ego, vehicle_id=np.array([f"car{i}" for i in range(count)]))


def observed(frame, road):
    return build_sensor(sensor_settings("lidar", {})).observe(frame, road, np.random.default_rng(3))


def tracked(frame, observation, rng):
    near = np.flatnonzero((observation.state < 3) & (np.arange(len(frame)) != frame.ego))
    hidden = observation.state[near] == 2
    std_lon, std_lat = np.where(hidden, 2.5, 0.25), np.where(hidden, 0.5, 0.15)
    zeros = np.zeros(len(near))
    lon = frame.lon_m[near] + std_lon * rng.standard_normal(len(near))
    lat = frame.lat_m[near] + std_lat * rng.standard_normal(len(near))
    tracks = Tracks(
        track_id=np.arange(1, len(near) + 1), lon_m=lon, lat_m=lat, speed_mps=zeros + 12.0, lat_speed_mps=zeros,
        accel_mps2=zeros, std_lon_m=std_lon, std_lat_m=std_lat, std_speed_mps=zeros + 1.0, existence=zeros + 1.0,
        state=np.where(hidden, HIDDEN, CONFIRMED).astype(np.int8),
    )  # fmt: skip
    spread = rng.standard_normal((2, 200, len(near))) * np.stack([std_lon, std_lat])[:, None]
    particles = (np.stack([tracks.lon_m, tracks.lat_m])[:, None] + spread).reshape(2, -1)
    return tracks, particles


@pytest.fixture
def road():
    lanes = (*highway().lanes, Lane(number=6, right_m=-3.66, left_m=0.0, start_m=188.0, end_m=345.0))
    return CorridorRoad(lanes=lanes)


def test_the_scene_is_drawn_to_scale_with_every_track_in_range(road):
    frame = jam()
    observation = observed(frame, road)
    tracks, particles = tracked(frame, observation, np.random.default_rng(0))
    axes = Figure((20.0, 4.0)).subplots()  # wide enough for all numbers
    named = str(frame.vehicle_id[3])
    draw_scene(axes, PictureScene(frame, observation, tracks, road, 100.0, particles, named), (-102.5, 102.5))
    assert axes.get_aspect() == 1.0
    assert "metres" in axes.get_xlabel()
    assert "(m)" in axes.get_ylabel()
    assert sum(isinstance(patch, Ellipse) for patch in axes.patches) == len(tracks)
    bodies = next(c for c in axes.collections if isinstance(c, PatchCollection)).get_paths()
    centres = np.array([body.vertices[:4].mean(axis=0) for body in bodies])
    assert centres[:, 0] == pytest.approx(frame.lon_m - frame.lon_m[frame.ego])
    assert centres[:, 1] == pytest.approx(frame.lat_m)
    written = {text.get_text() for text in axes.texts}
    assert {str(number) for number in tracks.track_id} <= written
    assert "ego" in written
    (name,) = (text for text in axes.texts if text.get_text() == named)
    assert name.xy == pytest.approx((centres[3, 0], centres[3, 1] - 0.5 * frame.width_m[3]))


def test_every_kind_of_thing_is_in_the_legend_once():
    labels = [entry.get_label() for entry in legend_entries(with_particles=True, with_walls=True)]
    assert len(labels) == len(set(labels)) == 12
    assert len(legend_entries(with_particles=False, with_walls=False)) == 10


def test_the_figure_can_be_saved_without_tracks_or_particles_and_on_a_bend(road):
    angle = np.linspace(0.0, 1.5, 60)
    line = tuple(zip(400 * np.sin(angle), 400 - 400 * np.cos(angle), strict=True))
    for ground in (road, replace(road, reference_xy=line)):
        frame = jam(count=12)
        scene = PictureScene(frame, observed(frame, ground), Tracks.none(), ground, 100.0)
        figure = scene_figure(scene, title="No tracks")
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=40)
        assert buffer.getvalue().startswith(b"\x89PNG")
        assert len(figure.axes) == 2


def test_a_long_title_goes_on_in_the_next_line(road):
    scene = PictureScene(jam(count=2), observed(jam(count=2), road), Tracks.none(), road, 100.0)
    figure = scene_figure(scene, title="recording_of_a_long_name " * 8)
    assert figure.texts[0].get_window_extent().x1 < figure.bbox.x1
