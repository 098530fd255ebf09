"""A few seeded ends; more on demand: ``python -m tests.kill --kills 40 --seed 1``."""

import pytest

from tests.kill.killing import kill_often


@pytest.mark.slow
def test_a_kill_loses_nothing_that_was_finished_and_what_is_taken_up_ends_as_if_it_never_was(tmp_path):
    kills = kill_often(2, 7, tmp_path)
    assert not [kill.as_line() for kill in kills if kill.faults]
