"""The command that tunes: what it asks for, follows and writes, over traffic that is made up."""

from __future__ import annotations

import os
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.config.model import SensorConfig
from harness.grid import tuning
from harness.grid.pool import ONE_THREAD
from harness.grid.tuning import DENSITIES, Followed, Recording, main, recordings_shared, tune
from harness.grid.tuning_search import Scores, Trial, search
from harness.grid.tuning_spaces import SEARCH_SPACES, nested
from harness.running.follow import track
from harness.scoring import score_run
from harness.trackers.catalogue import TUNED_FILE, build_tracker
from tests.golden import equals_golden
from tests.harness.stand_ins import SteadyTraffic, looking_at

GOLDEN = Path(__file__).parent / "golden"
RECORDINGS = [Recording(20.0, 100 + seed, 1.0, "lidar") for seed in range(3)]


def test_help_tells_every_option(monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr(tuning, "SEARCH_SPACES", {"one": {}, "another": {}})
    equals_golden(tuning._parser().format_help().split("\n\n", 1)[1], GOLDEN / "tuning-help.txt")
    chosen = tuning._parser().parse_args(["--tracker", "pmbm"])
    assert vars(chosen) == {
        "tracker": "pmbm", "seeds": "100:102", "duration": 20.0, "sensor": SensorConfig().profile, "trials": 24,
        "processes": 1, "write": False,
    }  # fmt: skip


@pytest.fixture
def asked(monkeypatch) -> dict:
    """Let nothing be followed: what is asked for is noted, and a score is made up of the options."""
    noted: dict = {"shared": [], "tried": [], "written": []}

    @contextmanager
    def shared(recordings, processes):
        noted["shared"].append((list(recordings), processes))

        def try_on(tracker, options):
            noted["tried"].append(tracker)
            return Scores(50.0 + (options.get("lon_noise", 0) or 0), 60.0)

        yield try_on

    monkeypatch.setattr(tuning, "recordings_shared", shared)
    monkeypatch.setattr(tuning, "write_outcome", lambda outcome, path: noted["written"].append((outcome, path)))
    return noted


def test_each_tracker_is_tried_on_all_recordings_and_told_in_a_line(asked, capsys, monkeypatch):
    monkeypatch.setattr(tuning, "default_options", lambda tracker: {"lon_noise": 1.0, "gate_std": None})
    monkeypatch.setattr(tuning, "ladders", lambda tracker: {"lon_noise": [0.3, 1.0, 3.0], "gate_std": [None, 2]})
    monkeypatch.setattr(tuning, "perf_counter", iter(np.arange(100.0) ** 2).__next__)
    main(["--tracker", "oracle-kalman,pmbm", "--seeds", "101:103", "--trials", "3", "--duration", "5"])
    recordings = [
        Recording(density, seed, 5.0, SensorConfig().profile) for density in (20.0, 45.0) for seed in (101, 102)
    ]
    assert asked == {"shared": [(recordings, 1)], "tried": ["oracle-kalman"] * 3 + ["pmbm"] * 3, "written": []}
    out, err = capsys.readouterr()
    equals_golden(out + err, GOLDEN / "tuning-told.txt")


def test_what_was_found_is_written_with_the_command_that_finds_it_again(asked):
    main(["--tracker", "oracle-kalman", "--trials", "2", "--processes", "3", "--sensor", "radar", "--write"])
    ((outcome, path),) = asked["written"]
    assert path == TUNED_FILE
    assert (outcome.tracker, len(outcome.trials), asked["shared"][0][1]) == ("oracle-kalman", 2, 3)
    assert outcome.command == (
        "python -m harness.grid.tuning --tracker oracle-kalman --seeds 100:102 --duration 20 --sensor radar --trials 2 "
        "--write"
    )
    assert outcome.recordings == [
        {"density": density, "seed": seed, "duration_s": 20.0, "sensor": "radar"}
        for density in DENSITIES
        for seed in (100, 101)
    ]


def test_all_are_all_trackers_that_have_a_space(asked):
    main(["--tracker", "all", "--trials", "1"])
    assert asked["tried"] == list(SEARCH_SPACES)


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (
            ["--tracker", "pmbm,kalmann,x"],
            f"--tracker kalmann: unknown; choose all, or from {', '.join(SEARCH_SPACES)}",
        ),
        (["--tracker", "pmbm", "--trials", "0"], "--trials and --processes: give 1 or more"),
        (["--tracker", "pmbm", "--processes", "0"], "--trials and --processes: give 1 or more"),
        (["--tracker", "pmbm", "--seeds", "7"], "--seeds 7: give two numbers as A:B"),
        (["--tracker", "pmbm", "--seeds", "99:101"], "--seeds 99:101: tuning is done on seeds from 100 to 199 only"),
        (["--tracker", "pmbm", "--seeds", "150:150"], "--seeds 150:150: tuning is done on seeds from 100 to 199 only"),
        (["--tracker", "pmbm", "--seeds", "199:201"], "--seeds 199:201: tuning is done on seeds from 100 to 199 only"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(asked, words, problem, capsys):
    with pytest.raises(SystemExit) as refused:
        main(words)
    assert refused.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1] == f"python -m harness.grid.tuning: error: {problem}"


def test_the_first_and_the_last_tuning_seed_may_be_used(asked):
    main(["--tracker", "pmbm", "--trials", "1", "--seeds", "100:200"])
    assert [each.seed for each in asked["shared"][0][0]] == [*range(100, 200)] * 2


def followed_by(monkeypatch) -> list:
    """Let a recording's scores be its seed, and note which recordings are followed together."""
    together: list = []

    def follow_all(tracker, options, recordings):
        together.append((tracker, options, recordings))
        return [Followed(Scores(float(each.seed), 1.0), 1.0) for each in recordings]

    monkeypatch.setattr(tuning, "follow_all", follow_all)
    return together


def test_one_process_follows_all_recordings_itself(monkeypatch):
    together = followed_by(monkeypatch)
    with recordings_shared(RECORDINGS, 1) as try_on:
        assert try_on("pmbm", {"a": 1}).hota == 101.0
    assert together == [("pmbm", {"a": 1}, tuple(RECORDINGS))]


class Executor:
    """A process of one worker that is this one."""

    made: list[tuple]

    def __init__(self, workers: int, context) -> None:
        Executor.made.append((workers, context.get_start_method()))

    def __enter__(self) -> Executor:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def submit(self, work, *words) -> Future:
        told: Future = Future()
        told.set_result(work(*words))
        return told


@pytest.mark.parametrize(("processes", "shares"), [(2, [[0, 2], [1]]), (5, [[0], [1], [2]])])
def test_recordings_are_dealt_out_to_processes_of_one_thread(processes, shares, monkeypatch):
    Executor.made = []
    for name in ONE_THREAD:
        monkeypatch.setenv(name, "8")
    monkeypatch.setattr(tuning, "ProcessPoolExecutor", Executor)
    together = followed_by(monkeypatch)
    with recordings_shared(RECORDINGS, processes) as try_on:
        assert try_on("pmbm", {}).hota == 101.0
        assert [os.environ[name] for name in ONE_THREAD] == ["1"] * len(ONE_THREAD)
    assert [list(each[2]) for each in together] == [[RECORDINGS[place] for place in share] for share in shares]
    assert Executor.made == [(1, "spawn")] * len(shares)


def test_a_recording_is_followed_by_the_tracker_with_its_options(monkeypatch):
    looks = looking_at(SteadyTraffic(steps=8, cars_per_lane=2))(tuning.RunConfig()).kept()
    monkeypatch.setattr(tuning, "_looks", lambda recording: looks if recording == RECORDINGS[1] else None)
    scored: list = []

    def score(truth, detections, tracks, seed):
        scored.append((seed, score_run(truth, detections, tracks, seed), tracks))
        return scored[0][1]

    monkeypatch.setattr(tuning, "score_run", score)
    options = {"confirm_detections": 2}
    (followed,) = tuning.follow_all("oracle-kalman", options, (RECORDINGS[1],))
    tables = track(looks, lambda setting: build_tracker("oracle-kalman", setting, nested(options)), 101)
    ((seed, told, tracks),) = scored
    assert seed == 101
    pd.testing.assert_frame_equal(tracks, tables.tracks)
    assert repr(followed.scores) == repr(Scores.of(told.metrics))
    assert told.metrics["mot"]["hota"] > 0.0
    assert 0.001 < followed.ms_per_step < 1000.0


def test_a_recording_is_of_us101_at_its_density_seed_length_and_sensor(monkeypatch):
    opened: list = []

    class Looks:
        def kept(self) -> str:
            return "kept"

    monkeypatch.setattr(tuning, "open_looks", lambda config: opened.append(config) or Looks())
    tuning._looks.cache_clear()
    try:
        assert [tuning._looks(Recording(45.0, 107, 12.5, "radar")) for _ in range(2)] == ["kept"] * 2
    finally:
        tuning._looks.cache_clear()
    (config,) = opened
    assert (config.seed, config.sensor.profile) == (107, "radar")
    assert (config.traffic.net, config.traffic.density, config.traffic.duration_s) == ("us101", 45.0, 12.5)


def test_a_search_tries_settings_in_this_order():
    """Each setting is moved while that helps, first up, then down; then pairs are drawn, the same in every search."""
    ladders = {"a": [0, 1, 2], "b": ["x", "y"], "c": [5, 6, 7]}

    def score(options) -> Trial:
        value = options["a"] + (options["b"] == "y") - abs(options["c"] - 5)
        return Trial(dict(options), Scores(float(value), 0.0))

    trials = search({"a": 1, "b": "x", "c": 6}, ladders, score, 18)
    tried = "\n".join(f"{trial.options} {trial.objective:g}" for trial in trials)
    equals_golden(tried + "\n", GOLDEN / "search.txt")


def test_a_trial_is_told_on_stderr_with_its_scores_options_and_time(capsys, monkeypatch):
    monkeypatch.setattr(tuning, "perf_counter", iter((10.0, 52.0)).__next__)
    monkeypatch.setattr(tuning, "default_options", lambda tracker: {"a": None})
    monkeypatch.setattr(tuning, "ladders", lambda tracker: {"a": [None]})
    (trial,) = tune("pmbm", 1, lambda tracker, options: Scores(90.0, 80.0, 1.0, 0.5))
    assert capsys.readouterr().err == f'pmbm 79.00 {trial.scores} {{"a": null}} 42 s\n'
