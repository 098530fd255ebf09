"""The follower that draws from a table: from the right cell, as often as is in it, and from no broken file."""

import numpy as np
import pytest

from mmpf.motion.gmm.model_file import ModelFileError, load_arrays, save_arrays
from mmpf.motion.learned.empirical import EmpiricalFollower, load_empirical, save_empirical
from mmpf.motion.state import ACCEL
from tests.mmpf.motion.surroundings import states, vehicle

EDGES = (np.log([10.0, 30.0]), np.array([10.0]), np.array([0.0]), np.array([-1.0, 1.0]))


@pytest.fixture
def table():
    changes = np.arange(3 * 2 * 2 * 3, dtype=np.float64).reshape(3, 2, 2, 3, 1) + np.array([0.0, 0.5])
    return EmpiricalFollower(EDGES, changes)


def test_a_change_is_drawn_evenly_between_the_quantiles_of_the_situations_own_cell(table):
    n = 2000
    state, leader = states(n, 15.0), vehicle(n, 20.0, 17.0)
    state[ACCEL] = 0.3
    drawn = table.accelerations(state, np.empty((0, n)), leader, np.arange(n), 0.1, np.random.default_rng(0)) - 0.3
    least = float(table.changes_mps2[1, 1, 0, 1, 0])
    assert ((drawn >= least) & (drawn <= least + 0.5)).all()
    assert drawn.mean() == pytest.approx(least + 0.25, abs=0.01)


def test_a_table_is_read_back_as_it_was_written(table, tmp_path):
    save_empirical(tmp_path / "own.npz", table)
    again = load_empirical(tmp_path / "own.npz")
    np.testing.assert_array_equal(again.changes_mps2, table.changes_mps2)
    for mine, read in zip(table.edges, again.edges, strict=True):
        np.testing.assert_array_equal(mine, read)


@pytest.mark.parametrize(("name", "value"), [("edges.speed", np.array([2.0, 1.0])), ("changes", np.zeros((3, 2, 2)))])
def test_a_file_that_holds_no_table_is_refused(name, value, table, tmp_path):
    path = tmp_path / "own.npz"
    save_empirical(path, table)
    save_arrays(path, load_arrays(path, "empirical") | {name: value})
    with pytest.raises(ModelFileError, match=name):
        load_empirical(path)
