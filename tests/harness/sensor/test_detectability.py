"""Each vehicle's own factor on its detection probability, and false objects of the kinds that are off by default."""

from dataclasses import replace

import numpy as np
import pytest

from harness.sensor.failings import drawn_factors
from harness.sensor.profiles import sensor_settings
from tests.harness.sensor.sensor_scenes import AROUND, CALM, false_places, film, frame_of

pytestmark = [pytest.mark.usefixtures("no_shadows"), pytest.mark.slow]


def shares(seen):
    return {f"car{k}": np.mean([f"car{k}" in one.truth_id for one in seen]) for k in range(1, 11)}


def test_a_vehicle_keeps_its_detectability_all_along():
    seen = film([frame_of(*AROUND)] * 400, **CALM, detectability_share=0.5)
    first, second = shares(seen[:200]), shares(seen[200:])
    assert all(abs(first[name] - second[name]) < 0.12 for name in first)
    dark = [name for name in first if first[name] < 0.99]
    assert 2 <= len(dark) <= 8
    assert all(first[name] > 0.25 for name in dark)


def test_factors_have_the_asked_for_share_mean_and_least():
    asked = {"share": 0.3, "least": 0.4, "mean": 0.7, "spread": 0.15}
    settings = sensor_settings("lidar", {f"detectability_{name}": value for name, value in asked.items()})
    factor = drawn_factors(settings, 20_000, np.random.default_rng(1))
    hard = factor[factor < 1.0]
    assert len(hard) / 20_000 == pytest.approx(0.3, abs=0.01)
    assert hard.mean() == pytest.approx(0.7, abs=0.01)
    assert hard.std() == pytest.approx(0.15, abs=0.01)
    assert hard.min() >= 0.4


def test_narrow_vehicles_are_seen_less_often_than_wide_ones():
    frame = frame_of(*AROUND)
    narrow = np.where(np.arange(len(frame)) % 2 == 1, 0.8, 1.9)
    seen = shares(film([replace(frame, width_m=narrow)] * 200, **CALM, detectability_narrow=0.6))
    for k in range(1, 11):
        assert seen[f"car{k}"] == (pytest.approx(0.6, abs=0.08) if k % 2 else 1.0)


def test_detectability_shifts_no_draw_of_false_objects_nor_of_the_first_scan():
    frames = [frame_of(*AROUND)] * 30
    plain, dark = (film(frames, **CALM, persistent_clutter=4.0, detectability_share=share) for share in (0.0, 0.5))
    for one, other in zip(plain, dark, strict=True):
        assert sorted(false_places(one)[0]) == sorted(false_places(other)[0])
    where = [dict(zip(one.truth_id, one.scan.detections.lon_m, strict=True)) for one in (plain[0], dark[0])]
    assert {name: where[0][name] for name in where[1] if name} == {name: where[1][name] for name in where[1] if name}


def test_mirror_images_keep_their_distance_to_a_vehicle():
    frames = [frame_of((30.0 + 2.0 * k, 0.0)) for k in range(25)]
    seen = film(frames, **CALM, mirrored_clutter=2.0, mirrored_clutter_s=1e6, mirrored_clutter_probability=1.0)
    counts = {len(false_places(one)[0]) for one in seen}
    assert len(counts) == 1
    assert counts != {0}
    for k, one in enumerate(seen):
        lon, lat = false_places(one)
        ahead, aside = lon - frames[k].lon_m[1], np.abs(lat - frames[k].lat_m[1])
        assert (np.abs(ahead) < 8.0).all()
        assert ((aside > 2.0) & (aside < 9.0)).all()


def test_posts_stand_at_the_same_places_for_the_whole_run_and_for_each_ego():
    frames = [replace(frame_of(ego_lon=300.0), episode=k // 60) for k in range(120)]
    seen = film(frames, **CALM, posts_per_km=20.0, std_lon_m=0.01, std_bearing_deg=0.0)
    first, second = (np.concatenate([false_places(one)[0] for one in part]) for part in (seen[:60], seen[60:]))
    places = [place for place in np.unique(np.round(first / 2.0)) if (np.round(first / 2.0) == place).sum() > 5]
    assert len(places) >= 5
    for place in places:
        assert np.isin([place - 1, place, place + 1], np.round(second / 2.0)).any()
    # Five lanes of 200 m in range, nine scans in ten.
    assert len(first) / 60 == pytest.approx(0.9 * 20.0, rel=0.5)


def test_posts_behind_a_vehicle_are_seen_only_where_shadows_do_not_hide_them():
    wall = [(10.0 * k, 2.6) for k in range(-9, 10)]
    frame = frame_of(*wall)
    frame = replace(frame, length_m=np.full(len(frame), 10.0))
    seen = {
        hides: film([frame] * 30, **CALM, posts_per_km=50.0, persistent_clutter_occluded=hides)
        for hides in (False, True)
    }
    beyond = {hides: sum((false_places(one)[1] > frame.lat_m[0] + 5.0).sum() for one in seen[hides]) for hides in seen}
    assert beyond[False] > 100
    assert beyond[True] <= 0.1 * beyond[False]


def test_a_car_of_any_length_is_two_boxes_where_the_bound_is_nought():
    frame = frame_of((30.0, 0.0))
    for length_m, boxes in ((8.0, 1.0), (0.0, 2.0)):
        seen = film([frame] * 20, **CALM, split_share=0.9, split_s=1e3, split_length_m=length_m)
        assert max(len(one.truth_id) for one in seen) == boxes
