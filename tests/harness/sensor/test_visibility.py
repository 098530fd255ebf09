from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.sensor.visibility import first_hits, pack_boxes, visible_fractions

CAR = (4.7, 1.9)


def seen_from(sensor_xy, bodies):
    """Return visible fractions and occluders where there is no wall."""
    return visible_fractions(sensor_xy, bodies, bodies[:, :0])[:2]


@dataclass(frozen=True)
class Scene:
    """Rows of (x, y, heading, length, width) seen from the origin."""

    rows: np.ndarray

    def look(self):
        return seen_from((0.0, 0.0), self.rows.T)


def cars(*positions, heading=0.0):
    return Scene(np.array([[x, y, heading, *CAR] for x, y in positions]).reshape(-1, 5))


def random_scene(rng, most=12):
    """Return rotated rectangles that may overlap, one of them exactly behind another; none holds the origin."""
    count = int(rng.integers(2, most))
    distance, bearing = rng.uniform(8, 80, count), rng.uniform(-np.pi, np.pi, count)
    length, width = rng.uniform(2, 14, count), rng.uniform(0.8, 2.6, count)
    heading = rng.uniform(-np.pi, np.pi, count)
    rows = np.stack([distance * np.cos(bearing), distance * np.sin(bearing), heading, length, width], axis=-1)
    behind = rows[0] * (rng.uniform(1.3, 2.0), 0, 1, 1, 1)
    behind[1] = rows[0, 1] * behind[0] / rows[0, 0]
    return Scene(np.concatenate([rows, [behind]]))


def cast_rays(scene, rays=10_000):
    """Return visible fractions by brute force: each ray against each edge of each rectangle."""
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
    x, y, heading, length, width = scene.rows.T
    offsets = signs[None] * np.stack([length, width], axis=-1)[:, None]
    cosine, sine = np.cos(heading)[:, None], np.sin(heading)[:, None]
    start_x = (x[:, None] + offsets[..., 0] * cosine - offsets[..., 1] * sine)[..., None]
    start_y = (y[:, None] + offsets[..., 0] * sine + offsets[..., 1] * cosine)[..., None]
    edge_x, edge_y = np.roll(start_x, -1, axis=1) - start_x, np.roll(start_y, -1, axis=1) - start_y
    fractions = []
    for i in range(len(scene.rows)):
        half = np.arcsin(min(1.0, np.hypot(length[i], width[i]) / 2 / np.hypot(x[i], y[i])))
        bearings = np.arctan2(y[i], x[i]) + half * (2 * (np.arange(rays) + 0.5) / rays - 1)
        ray_x, ray_y = np.cos(bearings), np.sin(bearings)
        cross = ray_x * edge_y - ray_y * edge_x
        distance = (start_x * edge_y - start_y * edge_x) / cross
        along_edge = (start_x * ray_y - start_y * ray_x) / cross
        hit = (distance > 0) & (along_edge >= 0) & (along_edge <= 1)
        depth = np.where(hit, distance, np.inf).min(axis=1)
        own = np.isfinite(depth[i])
        fractions.append((depth[i] <= depth.min(axis=0))[own].mean())
    return np.array(fractions)


def test_a_road_without_vehicles_gives_empty_answers():
    fraction, occluder = cars().look()
    assert fraction.shape == occluder.shape == (0,)


@pytest.mark.parametrize(
    ("places", "fractions", "occluders"),
    [
        ([(20.0, 3.0)], [1.0], [-1]),
        ([(20.0, 1.0), (20.0, 1.0)], [1.0, 1.0], [-1, -1]),
        ([(1.0, 0.2), (20.0, 0.0), (-20.0, 3.0)], [1.0, 0.0, 0.0], [-1, 0, 0]),
        ([(2.35, 0.0), (20.0, 0.0)], [1.0, 0.0], [-1, 0]),
    ],
    ids=["a lone car", "two in one place", "one around the sensor", "one whose edge the sensor is on"],
)
def test_who_is_seen_and_who_is_hidden_by_whom(places, fractions, occluders):
    fraction, occluder = cars(*places).look()
    assert fraction == pytest.approx(fractions)
    assert occluder.tolist() == occluders


def test_the_visible_fraction_of_a_half_covered_wall_follows_from_trigonometry():
    wall, screen = [0.0, 20.0, 0.0, 40.0, 0.002], [5.0, 10.0, 0.0, 10.0, 0.002]
    fraction, occluder = Scene(np.array([wall, screen])).look()
    assert fraction == pytest.approx([0.5, 1.0], abs=1e-3)
    assert occluder.tolist() == [1, -1]


def test_the_car_that_covers_most_is_the_occluder():
    wall = [30.0, 0.0, np.pi / 2, 12.0, 1.0]
    narrow, broad = [15.0, 2.0, np.pi / 2, 0.5, 0.5], [15.0, -1.5, np.pi / 2, 2.0, 0.5]
    assert Scene(np.array([wall, narrow, broad])).look()[1].tolist() == [2, -1, -1]


def test_cars_that_touch_hide_only_what_lies_behind():
    fraction, _ = cars((20.0, 0.0), (24.7, 0.0), (20.0, 1.9)).look()
    assert fraction[0] == pytest.approx(1.0)
    assert fraction[1] == pytest.approx(0.0, abs=1e-9)
    assert 0.9 < fraction[2] <= 1.0


def largest_disagreement(scenes, seed):
    rng = np.random.default_rng(seed)
    worst = 0.0
    for _ in range(scenes):
        scene = random_scene(rng)
        with np.errstate(divide="ignore", invalid="ignore"):
            worst = max(worst, float(np.abs(scene.look()[0] - cast_rays(scene)).max()))
    return worst


def test_visibility_agrees_with_ten_thousand_rays_on_a_few_random_scenes():
    assert largest_disagreement(scenes=8, seed=1) < 0.01


@pytest.mark.slow
def test_visibility_agrees_with_ten_thousand_rays_on_three_hundred_random_scenes():
    assert largest_disagreement(scenes=300, seed=2) < 0.01


seeds = st.integers(0, 2**32 - 1)
coordinate = st.integers(-12, 12).map(float)
any_rectangle = st.tuples(
    coordinate, coordinate, st.sampled_from([0.0, 0.5, np.pi / 2, np.pi]), *[st.integers(1, 6)] * 2
)
any_scene = st.lists(any_rectangle, min_size=1, max_size=8).map(lambda rows: Scene(np.array(rows, dtype=float)))


@given(any_scene)
def test_fractions_stay_within_bounds_and_every_covered_rectangle_has_an_occluder(scene):
    fraction, occluder = scene.look()
    assert ((fraction >= 0.0) & (fraction <= 1.0)).all()
    assert ((occluder >= 0) == (fraction < 1.0 - 1e-9)).all()
    assert (occluder != np.arange(len(occluder))).all()


@given(seeds, st.floats(-10, 10), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.booleans())
def test_turning_shifting_and_mirroring_the_scene_change_nothing(seed, turn, shift_x, shift_y, mirrored):
    scene = random_scene(np.random.default_rng(seed))
    fraction, occluder = scene.look()
    x, y, heading, length, width = scene.rows.T
    if mirrored:
        y, heading = -y, -heading
    moved_x = x * np.cos(turn) - y * np.sin(turn) + shift_x
    moved_y = x * np.sin(turn) + y * np.cos(turn) + shift_y
    moved = seen_from((shift_x, shift_y), np.stack([moved_x, moved_y, heading + turn, length, width]))
    assert moved[0] == pytest.approx(fraction, abs=1e-7)
    assert moved[1].tolist() == occluder.tolist()


def test_a_ray_is_told_where_it_enters_and_leaves_the_first_body():
    boxes = pack_boxes((0.0, 0.0), *cars((30.0, 0.0), (50.0, 0.0), (0.0, -10.0)).rows.T)
    index, entry, leave = first_hits(boxes, np.array([0.0, -np.pi / 2, 2.0]))
    assert index.tolist() == [0, 2, -1]
    assert entry == pytest.approx([27.65, 9.05, np.inf])
    assert leave == pytest.approx([32.35, 10.95, np.inf])
