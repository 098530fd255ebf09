import json
import time

import numpy as np
import pytest

from tests.harness.scoring.scenes import Scene, score_run, traffic

MOT = {"hota", "deta", "assa", "idf1", "mota", "id_switches", "fragmentations", "missed", "false_tracks"}
PUBLISHED = {
    **{
        f"mae.{state}": {"lon_m", "lat_m", "speed_mps", "lat_speed_mps", "n"}
        for state in ("all", "visible", "partial", "hidden")
    },
    "mot": MOT,
    "mot_all": MOT,
    "gospa": {"mean", "localisation", "missed", "false"},
    "occlusion": {"events", "survived", "hijacked", "lost", "same_id", "median_reacquire_s"},
    "calibration": {"nees"},
    "calibration.coverage95": {"lon", "lat", "speed"},
}
SCORED_ALIKE = ("mot", "mot_all", "gospa", "occlusion.short", "hidden_outcomes", "calibration.hidden.coverage95")


def at(metrics, path):
    for key in path.split("."):
        metrics = metrics[key]
    return metrics


@pytest.fixture(scope="module")
def tables():
    return traffic(steps=150, vehicles=30)


@pytest.fixture(scope="module")
def scored(tables):
    return score_run(*tables)


def test_every_published_key_is_there(scored):
    for path, keys in PUBLISHED.items():
        assert keys <= at(scored.metrics, path).keys(), path
    for row in scored.metrics["mae"]["by_seconds_hidden"]:
        assert {"from_s", "to_s", "lon_m", "speed_mps", "n"} <= row.keys()


def test_metrics_are_strict_json_even_where_there_is_nothing_to_score():
    metrics = score_run(*Scene(3).tables()).metrics
    assert json.loads(json.dumps(metrics, allow_nan=False)) == metrics
    assert metrics["mot"]["hota"] is None
    assert metrics["mae"]["hidden"]["lon_m"] is None


def test_the_order_of_the_rows_does_not_matter(tables, scored):
    shuffled = [table.sample(frac=1.0, random_state=1) for table in tables]
    metrics = score_run(*shuffled).metrics
    for path in ("mot.hota", "mot_all.id_switches", "mae.hidden.lon_m", "gospa.mean", "occlusion.same_id"):
        assert at(metrics, path) == pytest.approx(at(scored.metrics, path))


def test_other_names_for_vehicles_and_tracks_give_the_same_scores(tables, scored):
    truth, detections, tracks = tables
    number = tracks["track_id"].to_numpy()
    renamed = score_run(
        truth.assign(vehicle_id=truth["vehicle_id"].str[::-1]),
        detections.assign(truth_id=detections["truth_id"].str[::-1]),
        tracks.assign(track_id=np.random.default_rng(0).permutation(number.max() + 1)[number] * 1000 - 5000),
    )
    for path in SCORED_ALIKE:
        assert at(renamed.metrics, path) == pytest.approx(at(scored.metrics, path))


def test_another_origin_of_the_road_gives_the_same_scores(tables, scored):
    moved = [table.assign(lon_m=table["lon_m"] + 512.0, lat_m=table["lat_m"] - 64.0) for table in tables]
    metrics = score_run(*moved).metrics
    for path in SCORED_ALIKE:
        assert at(metrics, path) == pytest.approx(at(scored.metrics, path))


def test_means_are_those_of_the_error_table(scored):
    for state in ("visible", "partial", "hidden"):
        rows = scored.errors.query("state == @state and outcome == 'tracked'")
        mean = scored.metrics["mae"][state]
        assert mean["n"] == len(rows)
        assert mean["lon_m"] == pytest.approx(rows["lon_error_m"].abs().mean())
        assert mean["speed_mps_ci95"][0] <= mean["speed_mps"] <= mean["speed_mps_ci95"][1]


def test_a_tracker_that_reports_the_truth_is_perfect(tables):
    truth, detections, _ = tables
    known = truth[~truth["is_ego"] & truth["in_range"]].merge(
        detections.groupby("truth_id")["step"].min().rename("first"), left_on="vehicle_id", right_index=True
    )
    known = known[known["step"] >= known["first"]]
    tracks = known.assign(
        track_id=known["vehicle_id"].str[3:].astype(int),
        std_lon_m=1.0,
        std_lat_m=1.0,
        std_speed_mps=1.0,
        state=np.where(known["state"] == "hidden", "hidden", "confirmed"),
    )
    metrics = score_run(truth, detections, tracks).metrics
    assert metrics["mae"]["all"]["position_m"] == 0.0
    assert metrics["mot"]["missed"] == metrics["mot_all"]["missed"] == 0
    assert metrics["mot_all"]["id_switches"] == 0
    assert metrics["occlusion"]["same_id"] == metrics["occlusion"]["events"] > 0
    assert metrics["hidden_outcomes"]["tracked_percent"] == 100.0


def test_no_tracks_at_all_miss_everything(tables):
    truth, detections, tracks = tables
    metrics = score_run(truth, detections, tracks.iloc[:0]).metrics
    assert metrics["mot"]["missed"] == metrics["mot"]["truth_n"] > 0
    assert metrics["mot"]["hota"] == 0.0
    assert metrics["mae"]["all"]["n"] == 0
    assert metrics["occlusion"]["lost"] == metrics["occlusion"]["events"] > 0


def test_the_error_of_the_detections_is_that_of_their_noise(scored):
    noise = scored.metrics["detection_noise"]
    assert noise["lon_m"] == pytest.approx(0.3 * np.sqrt(2 / np.pi), rel=0.1)
    assert noise["lat_m"] == pytest.approx(0.2 * np.sqrt(2 / np.pi), rel=0.1)


@pytest.mark.slow
def test_a_minute_with_sixty_vehicles_is_scored_within_a_second():
    run = traffic(steps=600, vehicles=60)
    score_run(*run)
    started = time.perf_counter()
    score_run(*run)
    assert time.perf_counter() - started < 1.0
