from __future__ import annotations

import pytest

from harness.common.durations import rough_time, say_roughly
from harness.grid.expected import expected_s
from harness.grid.grid import GridRequest, plan_grid
from harness.running.expected import expected_tracking_s, expected_traffic_s
from harness.running.resolve import resolve_run_config


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (20, "a minute"),
        (61, "2 minutes"),
        (700, "15 minutes"),
        (5400, "90 minutes"),
        (7000, "2 hours"),
        (90_000, "2 days"),
        (1e9, "10 days"),
    ],
)
def test_a_guess_is_told_in_round_words(seconds, words):
    assert rough_time(seconds) == words


def test_what_takes_less_than_a_minute_is_not_announced():
    said: list[str] = []
    say_roughly(said.append, 59.0, "this run")
    assert said == []
    say_roughly(said.append, 600.0, "16 runs")
    assert said == ["16 runs: roughly 10 minutes, longer on a busy machine"]


def test_longer_denser_and_more_particles_are_guessed_to_take_longer():
    plain, *others = (
        expected_tracking_s(resolve_run_config(options=options))
        for options in ({}, {"duration": 120.0}, {"density": 60.0}, {"particles": 4000})
    )
    assert min(others) > plain


def test_a_recording_takes_no_simulation():
    simulated = resolve_run_config(options={})
    assert expected_traffic_s(simulated) > 10.0
    assert expected_traffic_s(simulated.model_copy(update={"replay": "recording.csv"})) == 0.0


def test_a_grid_is_guessed_to_take_less_on_more_workers_up_to_its_cells():
    cells = plan_grid(GridRequest(densities="20,40", seeds="2", trackers="mmpf", duration_s=60.0)).cells
    one, two, four, eight = (expected_s(cells, workers) for workers in (1, 2, 4, 8))
    assert one > two > four == eight
