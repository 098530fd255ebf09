import itertools

import numpy as np
import pytest

from harness.trackers.rivals.pmbm.murty import NOBODY, best_assignments


def all_assignments(gain: np.ndarray) -> list[float]:
    detections, tracks = gain.shape
    worths = []
    for choice in itertools.product(range(-1, tracks), repeat=detections):
        taken = [track for track in choice if track >= 0]
        worth = sum(gain[k, track] for k, track in enumerate(choice) if track >= 0)
        if len(taken) == len(set(taken)) and np.isfinite(worth):
            worths.append(worth)
    return sorted(worths, reverse=True)


@pytest.mark.parametrize("seed", range(20))
def test_the_best_assignments_are_those_of_all_that_are_worth_most(seed):
    rng = np.random.default_rng(seed)
    gain = rng.normal(1.0, 2.0, (rng.integers(1, 5), rng.integers(1, 5)))
    gain[rng.random(gain.shape) < 0.3] = -np.inf
    known = all_assignments(gain)
    found = best_assignments(gain, 12)
    assert [worth for worth, _ in found] == pytest.approx(known[:12])
    assert len({choice for _, choice in found}) == len(found)
    for worth, choice in found:
        assert worth == pytest.approx(sum(gain[k, track] for k, track in enumerate(choice) if track != NOBODY))


def test_assignments_that_are_worth_much_less_are_left_out():
    gain = np.array([[5.0, 1.0], [1.0, 5.0]])
    assert [worth for worth, _ in best_assignments(gain, 9, worst_loss=5.0)] == [10.0, 5.0, 5.0]
    assert len(best_assignments(gain, 9)) == len(all_assignments(gain))
