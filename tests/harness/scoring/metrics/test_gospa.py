import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.scoring.evidence.sequence import MotSequence
from harness.scoring.metrics.gospa import distances, gospa_of_steps

CUTOFF_M = 4.0


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), truths=st.integers(0, 4), tracks=st.integers(0, 4))
def test_gospa_equals_the_least_cost_over_all_assignments(seed, truths, tracks):
    rng = np.random.default_rng(seed)
    truth, track = rng.uniform(0, 6, (truths, 2)), rng.uniform(0, 6, (tracks, 2))
    scores = gospa_of([(truth, track)])
    assert scores["mean"] == pytest.approx(brute_force(truth, track))
    assert scores["mean"] == pytest.approx(scores["localisation"] + scores["missed"] + scores["false"])


def test_the_parts_are_averaged_over_steps():
    one, far, none = np.array([[0.0, 0.0]]), np.array([[0.0, 3.0]]), np.zeros((0, 2))
    scores = gospa_of([(one, far), (one, none), (none, one), (none, none)])
    assert (scores["localisation"], scores["missed"], scores["false"]) == pytest.approx((3.0 / 4, 2.0 / 4, 2.0 / 4))
    assert scores["mean"] == pytest.approx(7.0 / 4)


def brute_force(truth, track):
    best = np.inf
    for size in range(min(len(truth), len(track)) + 1):
        for rows in itertools.combinations(range(len(truth)), size):
            for columns in itertools.permutations(range(len(track)), size):
                gaps = [np.linalg.norm(truth[row] - track[column]) for row, column in zip(rows, columns, strict=True)]
                if any(gap >= CUTOFF_M for gap in gaps):
                    continue
                alone = len(truth) + len(track) - 2 * size
                best = min(best, sum(gaps) + CUTOFF_M / 2 * alone)
    return best


def gospa_of(sets):
    return gospa_of_steps([distances(sequence_of(sets))], np.random.default_rng(0))


def sequence_of(sets):
    truth_step = np.repeat(np.arange(len(sets)), [len(truth) for truth, _ in sets])
    track_step = np.repeat(np.arange(len(sets)), [len(track) for _, track in sets])
    truth, track = (np.concatenate([pair[side] for pair in sets]) for side in (0, 1))
    pair_truth, pair_track = np.nonzero(truth_step[:, None] == track_step)
    distance = np.linalg.norm(truth[pair_truth] - track[pair_track], axis=1)
    return MotSequence(
        steps=len(sets),
        truth_step=truth_step,
        truth_identity=np.zeros_like(truth_step),
        track_step=track_step,
        track_identity=np.zeros_like(track_step),
        pair_truth=pair_truth,
        pair_track=pair_track,
        pair_similarity=np.ones(len(pair_truth)),
        pair_distance_m=distance,
    )
