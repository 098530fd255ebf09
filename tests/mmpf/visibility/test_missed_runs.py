"""Runs of misses: the two-state chain beside each component, against its generator and against all of its paths."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from mmpf.joint.evidence import GatedLikelihoods, association_evidence
from mmpf.numerics.arrays import FloatArray
from mmpf.visibility.missed_runs import LASTS_ON, run_after_scan, run_expected

SHARE, RUN_S, DT_S = 0.12, 0.8, 0.1
IN_VIEW = 0.9


def transition(share: float, run_s: float, dt_s: float) -> FloatArray:
    """Probabilities from (outside, in a run) to the same, by the matrix exponential of the chain's rates."""
    ends = 1.0 / run_s
    begins = ends * share / (1.0 - share)
    return np.asarray(expm(dt_s * np.array([[-begins, begins], [ends, -ends]])))


@given(st.floats(0.0, 1.0), st.floats(0.0, 0.9), st.floats(0.1, 5.0), st.floats(0.01, 2.0))
def test_the_chain_moves_by_its_rates(now: float, share: float, run_s: float, dt_s: float) -> None:
    expected = np.array([1.0 - now, now]) @ transition(share, run_s, dt_s)
    assert run_expected(np.array([now]), share, run_s, dt_s) == pytest.approx(expected[[1]], abs=1e-9)


def test_how_long_runs_last_has_the_tail_of_a_lomax_distribution() -> None:
    run, step_s = np.array([1.0]), 0.001
    for k in range(3000):
        run = run_expected(run, 0.0, RUN_S + LASTS_ON * (k + 0.5) * step_s, step_s)
    assert run == pytest.approx([(1.0 + LASTS_ON * 3.0 / RUN_S) ** (-1.0 / LASTS_ON)], rel=1e-4)


@pytest.mark.parametrize("seen", list(product([True, False], repeat=4)))
def test_hits_and_misses_say_what_all_paths_of_the_chain_say_together(seen: tuple[bool, ...]) -> None:
    step = transition(SHARE, RUN_S, DT_S)
    mass = np.zeros(2)
    for path in product([0, 1], repeat=len(seen) + 1):
        weight = (1.0 - SHARE, SHARE)[path[0]]
        for before, after, hit in zip(path, path[1:], seen, strict=False):
            detected = 0.0 if after == 1 else IN_VIEW
            weight *= step[before, after] * (detected if hit else 1.0 - detected)
        mass[path[-1]] += weight
    run = np.array([SHARE])
    for hit in seen:
        run = run_expected(run, SHARE, RUN_S, DT_S)
        not_seen = 1.0 - IN_VIEW * (1.0 - run)
        # A clear detection claims the component beyond doubt: nothing else weighs beside it.
        run = run_after_scan(run, not_seen, np.array([1e12 if hit else 0.0]))
    assert run == pytest.approx(mass[[1]] / mass.sum(), abs=1e-9)


@given(st.floats(0.001, 0.999), st.floats(0.01, 0.99), st.floats(0.0, 100.0))
def test_a_detection_that_may_be_somebody_elses_is_weighed_with_the_two_ways_to_be_missed(
    run: float, detected: float, claimed: float
) -> None:
    missed_in_run, missed_outside = run, (1.0 - run) * (1.0 - detected)
    found = run_after_scan(np.array([run]), np.array([missed_in_run + missed_outside]), np.array([claimed]))
    assert found == pytest.approx([missed_in_run / (missed_in_run + missed_outside + claimed)])


@given(st.integers(0, 10_000))
@settings(deadline=None)
def test_to_be_seen_and_not_to_be_seen_are_all_there_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    starts = np.array([0, 3, 20])
    weight = np.concatenate([rng.dirichlet(np.ones(3)), rng.dirichlet(np.ones(17))])
    anywhere = GatedLikelihoods(np.array([0, 1]), np.array([0, 0]), np.ones(20), starts)
    seen, not_seen = association_evidence(weight, starts, rng.uniform(0.0, 1.0, 20), anywhere, 1)
    assert seen[:, 0] + not_seen == pytest.approx([1.0, 1.0])
