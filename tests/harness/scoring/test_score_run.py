import json

import numpy as np
import pytest

from tests.harness.scoring.scenes import Scene, score_run, traffic

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
