"""HOTA, CLEAR and identity scores equal those of TrackEval."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.scoring.evidence.history import detection_history
from harness.scoring.evidence.pairs import near_pairs
from harness.scoring.evidence.rows import read_run
from harness.scoring.evidence.sequence import MotSequence, mot_sequence, select_in_sight, select_remembered
from harness.scoring.metrics.clear import clear
from harness.scoring.metrics.hota import measure_hota
from harness.scoring.metrics.mot import idf1, measure_identity
from tests.harness.scoring.scenes import traffic

trackeval = pytest.importorskip("trackeval", reason="TrackEval is the oracle of these tests")

TOLERANCE = 1e-6


def test_scores_of_a_busy_run_equal_trackevals_for_both_sets_of_vehicles():
    for seed in range(2):
        rows = read_run(*traffic(steps=100, vehicles=40, seed=seed))
        history = detection_history(rows.truth)
        pairs = near_pairs(rows.truth, rows.tracks)
        for select in (select_in_sight, select_remembered):
            sequence = mot_sequence(rows, history, pairs, select(rows, history, pairs))
            assert len(sequence.pair_truth) > 500
            assert clear(sequence).id_switches > 0
            assert_equal_to_trackeval(sequence)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), density=st.floats(0.05, 1.0))
def test_scores_of_random_similarities_equal_trackevals(seed, density):
    assert_equal_to_trackeval(random_sequence(np.random.default_rng(seed), density))


def test_a_match_is_kept_although_another_track_is_nearer_by_now():
    # Vehicle 0 is followed by track 0; at step 1 track 1 is nearer, but track 0 is still within the gate.
    sequence = sequence_of([[(0, 0, 0.9)], [(0, 0, 0.6), (0, 1, 0.8)]], truths=1, tracks=2)
    assert clear(sequence).id_switches == 0
    assert_equal_to_trackeval(sequence)


def test_an_empty_set_of_tracks_or_of_vehicles_scores_zero():
    no_tracks = sequence_of([[], []], truths=2, tracks=0)
    no_truth = sequence_of([[], []], truths=0, tracks=2)
    for sequence in (no_tracks, no_truth):
        assert_equal_to_trackeval(sequence)
    assert clear(no_tracks).missed == 4
    assert clear(no_truth).false_tracks == 4


def assert_equal_to_trackeval(sequence: MotSequence) -> None:
    data = trackeval_data(sequence)
    quiet = {"PRINT_CONFIG": False}
    expected = trackeval.metrics.HOTA().eval_sequence(data)
    ours = measure_hota(sequence).scores()
    assert ours.hota == pytest.approx(expected["HOTA"].mean(), abs=TOLERANCE)
    assert ours.deta == pytest.approx(np.mean(expected["DetA"]), abs=TOLERANCE)
    assert ours.assa == pytest.approx(expected["AssA"].mean(), abs=TOLERANCE)
    expected = trackeval.metrics.CLEAR(quiet).eval_sequence(data)
    events = clear(sequence)
    assert events.mota == pytest.approx(expected["MOTA"], abs=TOLERANCE)
    assert events.id_switches == expected["IDSW"]
    assert events.fragmentations == expected["Frag"]
    assert events.missed == expected["CLR_FN"]
    assert events.false_tracks == expected["CLR_FP"]
    expected = trackeval.metrics.Identity(quiet).eval_sequence(data)
    assert idf1(*measure_identity(sequence)) == pytest.approx(expected["IDF1"], abs=TOLERANCE)


def trackeval_data(sequence: MotSequence) -> dict:
    truth_rows = [np.flatnonzero(sequence.truth_step == step) for step in range(sequence.steps)]
    track_rows = [np.flatnonzero(sequence.track_step == step) for step in range(sequence.steps)]
    similarity = np.zeros((len(sequence.truth_step), len(sequence.track_step)))
    similarity[sequence.pair_truth, sequence.pair_track] = sequence.pair_similarity
    return {
        "num_timesteps": sequence.steps,
        "num_gt_dets": len(sequence.truth_step),
        "num_tracker_dets": len(sequence.track_step),
        "num_gt_ids": len(np.unique(sequence.truth_identity)),
        "num_tracker_ids": len(np.unique(sequence.track_identity)),
        "gt_ids": [sequence.truth_identity[rows] for rows in truth_rows],
        "tracker_ids": [sequence.track_identity[rows] for rows in track_rows],
        "similarity_scores": [similarity[np.ix_(*rows)] for rows in zip(truth_rows, track_rows, strict=True)],
    }


def random_sequence(rng: np.random.Generator, density: float) -> MotSequence:
    """Vehicles and tracks that come and go at random, some steps without either, similarities at random."""
    steps, truths, tracks = rng.integers(1, 12), rng.integers(1, 7), rng.integers(1, 9)
    truth_present = (rng.random((steps, truths)) < 0.7) & (rng.random(steps) < 0.85)[:, None]
    track_present = (rng.random((steps, tracks)) < 0.7) & (rng.random(steps) < 0.85)[:, None]
    truth_step, truth_identity = np.nonzero(truth_present)
    track_step, track_identity = np.nonzero(track_present)
    pair_truth, pair_track = np.nonzero(
        (truth_step[:, None] == track_step) & (rng.random((len(truth_step), len(track_step))) < density)
    )
    return MotSequence(
        steps=int(steps),
        truth_step=truth_step,
        truth_identity=np.unique(truth_identity, return_inverse=True)[1],
        track_step=track_step,
        track_identity=np.unique(track_identity, return_inverse=True)[1],
        pair_truth=pair_truth,
        pair_track=pair_track,
        pair_similarity=rng.uniform(0.01, 1.0, len(pair_truth)),
        pair_distance_m=np.zeros(len(pair_truth)),
    )


def sequence_of(pairs_by_step, truths: int, tracks: int) -> MotSequence:
    """Every vehicle and every track at every step, similar as told: (vehicle, track, similarity)."""
    steps = len(pairs_by_step)
    pairs = [(step, *pair) for step, pairs in enumerate(pairs_by_step) for pair in pairs]
    return MotSequence(
        steps=steps,
        truth_step=np.repeat(np.arange(steps), truths),
        truth_identity=np.tile(np.arange(truths), steps),
        track_step=np.repeat(np.arange(steps), tracks),
        track_identity=np.tile(np.arange(tracks), steps),
        pair_truth=np.array([step * truths + vehicle for step, vehicle, _, _ in pairs], dtype=np.int64),
        pair_track=np.array([step * tracks + track for step, _, track, _ in pairs], dtype=np.int64),
        pair_similarity=np.array([similarity for *_, similarity in pairs], dtype=np.float64),
        pair_distance_m=np.zeros(len(pairs)),
    )
