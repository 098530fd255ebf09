import json

import pandas as pd
import pytest

from harness.running.nuscenes_boxes import nuscenes_scores


def write(path, boxes, samples=4, **more):
    """Write boxes at rest at a place on the x axis, in every sample."""
    results = {
        f"s{step}": [
            {"translation": [x, 0.0, 0.0], "tracking_id": name, "tracking_name": kind, **more}
            for name, kind, x in boxes
        ]
        for step in range(samples)
    }
    path.write_text(json.dumps({"meta": {}, "results": results}))
    return path


def test_boxes_beyond_the_range_of_their_class_do_not_count(tmp_path):
    truth = write(tmp_path / "truth.json", [("v", "car", 45.0), ("p", "pedestrian", 45.0), ("b", "barrier", 1.0)])
    tracks = write(tmp_path / "tracks.json", [("t", "car", 45.5), ("f", "car", 60.0)], tracking_score=0.5)
    table = {"sample_token": [f"s{step}" for step in range(4)], "episode": 0, "time_s": [0.0, 0.5, 1.0, 1.5]}
    poses = pd.DataFrame(table).assign(lon_m=0.0, lat_m=0.0)
    near = nuscenes_scores(truth, tracks, poses, 0.5)
    assert near["by_class"] == {"car": {"amota": 1.0, "amotp": pytest.approx(0.5)}}
    everywhere = nuscenes_scores(truth, tracks, None, 0.5)
    # As many false boxes as matched ones leave no accuracy.
    assert everywhere["by_class"]["car"]["amota"] == pytest.approx(0.0)
    assert everywhere["by_class"]["pedestrian"] == {"amota": 0.0, "amotp": 2.0}
    assert everywhere["amotp"] == pytest.approx((0.5 + 2.0) / 2)


def test_a_truth_of_boxes_without_a_point_of_the_lidar_has_nothing_to_score(tmp_path):
    truth = write(tmp_path / "truth.json", [("v", "car", 5.0)], num_pts=0)
    tracks = write(tmp_path / "tracks.json", [("t", "car", 5.0)], tracking_score=0.5)
    assert nuscenes_scores(truth, tracks, None, 0.5) is None
