from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from mmpf import MixtureTracker, Scan, SensorModel, motion_model
from mmpf.joint.sources import Sources
from tests.mmpf.scenes import ROAD, detections_at, ego_at, lane_centre

LOG_ODDS = np.array([0.5, 2.0, -0.3, 1.1])


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_scores_of_one_source_weigh_as_correlated_normals(correlation):
    # Of log odds whose variance is twice their mean each is the likelihood ratio of itself.
    covariance = 4.0 * (correlation + (1.0 - correlation) * np.eye(4))
    vehicle, false = (multivariate_normal(np.full(4, mean), covariance).logpdf(LOG_ODDS) for mean in (2.0, -2.0))
    sources, was_hit = Sources.newborn(np.array([1, 2]), np.ones(2)), np.array([True, False])
    for each in LOG_ODDS:
        sources = sources.after_scan(was_hit, 0.1, np.full(2, each))
    assert sources.score_log_odds(correlation) == pytest.approx([vehicle - false, 0.0])


def probability_of_a_vehicle(score):
    """Of one that drives along at 10 m/s, detected in every other scan of three seconds."""
    tracker = MixtureTracker(ROAD, SensorModel(), motion_model("cvm"), np.random.default_rng(0))
    for step in range(31):
        found = detections_at([(30.0 + step, lane_centre(3))][: 1 - step % 2])
        scores = None if score is None else np.full(len(found), score)
        tracks = tracker.step(Scan(0.1 * step, replace(found, score=scores), ego_at(2.0 * step)))
    return tracks.existence.max()


def test_sure_detections_make_a_vehicle_more_probable_and_unsure_ones_less():
    assert probability_of_a_vehicle(0.1) < 0.8 * probability_of_a_vehicle(0.5) < 0.9 * probability_of_a_vehicle(0.9)


def test_a_score_that_tells_nothing_changes_nothing():
    assert probability_of_a_vehicle(0.5) == probability_of_a_vehicle(None)
