"""A few seeded ends; more on demand: ``python -m tests.kill --kills 40 --seed 1``, ``--full-disks 20``."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.kill.filling import can_mount
from tests.kill.killing import kill_often

REPOSITORY = Path(__file__).parents[2]


@pytest.mark.slow
def test_nothing_finished_is_lost_by_a_kill_and_what_is_taken_up_ends_as_if_it_never_was(tmp_path):
    kills = kill_often(2, 7, tmp_path)
    assert not [kill.as_line() for kill in kills if kill.faults]


@pytest.mark.slow
@pytest.mark.skipif(not can_mount(), reason="no disks can be mounted here")
def test_nothing_finished_is_lost_on_a_full_disk_and_what_is_taken_up_ends_as_if_there_had_been_room(tmp_path):
    words = [sys.executable, "-m", "tests.kill", "--full-disks", "2", "--seed", "7"]
    ended = subprocess.run(words, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
