"""The command that tunes: what it asks for, follows and writes, over traffic that is made up."""

from __future__ import annotations

import math
import os
from functools import partial

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.config.model import SensorConfig
from harness.grid.pool import ONE_THREAD
from harness.lab.tuning import search
from harness.lab.tuning.search import HARD_TO_DETECT, Recording, follow, main, refusal
from harness.lab.tuning.spaces import SEARCH_SPACES, Range, default_options, nested
from harness.lab.tuning.trials import Found, Scores, Trial
from harness.scoring.score import score_run
from harness.sensor.detectability import drawn_factors
from harness.sensor.profiles import sensor_settings
from harness.trackers.catalogue import TUNED_FILE, build_tracker
from tests.harness.stand_ins import SteadyTraffic, looking_at, track

RECORDINGS = [Recording(20.0, 100 + seed, 1.0, "lidar") for seed in range(3)]


def test_options_have_their_defaults(monkeypatch):
    monkeypatch.setattr(search, "SEARCH_SPACES", {"one": {}, "another": {}})
    chosen = search._parser().parse_args(["--tracker", "pmbm"])
    assert vars(chosen) == {
        "tracker": "pmbm", "seeds": "100:104", "duration": 12.0, "sensor": SensorConfig().profile, "trials": 64,
        "processes": 1, "write": False,
    }  # fmt: skip


@pytest.fixture
def asked(monkeypatch) -> dict:
    """Let nothing be followed: what is asked for is noted, and a score is made up of the options."""
    noted: dict = {"followed": [], "written": []}

    def followed(tracker, options, recording):
        noted["followed"].append((tracker, recording))
        return Scores(50.0 + options.get("lon_noise", 0.0), 60.0)

    monkeypatch.setattr(search, "follow", followed)
    monkeypatch.setattr(search, "refusal", lambda tracker, options: "")
    monkeypatch.setattr(search, "write_outcome", lambda outcome, path: noted["written"].append((outcome, path)))
    return noted


def test_each_tracker_is_tried_on_all_recordings_and_told_in_a_line(monkeypatch, capsys):
    searched: list = []

    def tune(tracker, batches, budget):
        searched.append((tracker, batches, budget))
        trials = [
            Trial({"lon_noise": 1.0}, Scores(51.0, 60.0), 2),
            Trial({"lon_noise": 3.0, "gate_std": 2.0}, Scores(53.0, 60.0), 2),
            Trial({"lon_noise": 2.0}, Scores(59.0, 60.0), 1, stopped=True),
            Trial({"lon_noise": 2.5}, Scores(math.nan, math.nan), 0, refused="it lost a car"),
        ]
        return Found(trials, {"lon_noise": Range(0.3, 3.0), "gate_std": Range(1.0, 3.0)})

    monkeypatch.setattr(search, "tune", tune)
    main(["--tracker", "oracle-kalman,pmbm", "--seeds", "101:103", "--trials", "3", "--duration", "5"])
    batches = [
        [
            Recording(20.0, seed, 5.0, "lidar"),
            Recording(45.0, seed, 5.0, "lidar"),
            Recording(10.0, seed, 30.0, "lidar", broken_down=1, hard_share=0.3),
            Recording(10.0, seed, 30.0, "lidar", broken_down=3, hard_share=0.3),
        ]
        for seed in (101, 102)
    ]
    assert SensorConfig().profile == "lidar"
    assert searched == [("oracle-kalman", batches, 3), ("pmbm", batches, 3)]
    told = "55.50 -> 56.50 in 4 trials, 1 of them stopped early, 1 refused: "
    rest = '{"lon_noise": 3.0, "gate_std": 2.0}; at the end of its range: lon_noise (high)'
    assert capsys.readouterr().out.splitlines() == [f"{name}: {told}{rest}" for name in ("oracle-kalman", "pmbm")]


def test_every_trial_is_told_on_stderr_with_its_scores_options_and_time(asked, capsys, monkeypatch):
    monkeypatch.setattr(search, "perf_counter", iter((10.0, 52.0)).__next__)
    monkeypatch.setattr(search, "starts_of", lambda tracker: [{"lon_noise": 1.0}])
    monkeypatch.setattr(search, "space_of", lambda tracker: {"lon_noise": Range(0.1, 1.0)})
    found = search.tune("pmbm", [RECORDINGS[:2], RECORDINGS[2:]], 1)
    assert asked["followed"] == [("pmbm", each) for each in RECORDINGS]
    (trial,) = found.trials
    assert capsys.readouterr().err == f'pmbm 55.50 {trial.scores} {{"lon_noise": 1.0}} 42 s\n'


def test_a_setting_that_fails_a_check_is_refused_before_it_follows_anything(asked, capsys, monkeypatch):
    monkeypatch.setattr(search, "refusal", refusal)
    monkeypatch.setattr(search, "starts_of", lambda tracker: [{"confirm_detections": n} for n in (1000, 3)])
    monkeypatch.setattr(search, "space_of", lambda tracker: {"confirm_detections": Range(1, 10, whole=True)})
    found = search.tune("oracle-kalman", [RECORDINGS], 2)
    never_confirmed, usual = found.trials
    checks = [finding.partition(":")[0] for finding in never_confirmed.refused.split("; ")]
    assert checks[:2] == ["one_car_becomes_one_confirmed_track", "identities_stay_with_their_cars"]
    assert "0 confirmed tracks of one car; " in never_confirmed.refused
    assert (usual.refused, found.best) == ("", usual)
    assert len(asked["followed"]) == len(RECORDINGS)
    assert " refused for one_car_becomes" in capsys.readouterr().err.splitlines()[0]


def test_a_tracker_that_passes_with_no_setting_is_told_in_one_line(asked, capsys, monkeypatch):
    monkeypatch.setattr(search, "refusal", lambda tracker, options: "its cars swap")
    with pytest.raises(SystemExit) as ended:
        main(["--tracker", "oracle-kalman", "--trials", "8", "--write"])
    assert (ended.value.code, asked["followed"], asked["written"]) == (2, [], [])
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.endswith("every setting was refused, the first one for its cars swap; mend the tracker")


def test_the_usual_search_of_a_tracker_finds_better_settings(asked, capsys):
    main(["--tracker", "oracle-kalman", "--trials", "32"])
    out, err = capsys.readouterr()
    assert len(err.splitlines()) == 32
    assert "stopped after 1" in err
    assert out.startswith("oracle-kalman: 55.50 -> ")
    assert float(out.split()[3]) > 60.0


def test_what_was_found_is_written_with_the_command_that_finds_it_again(asked):
    main(["--tracker", "oracle-kalman", "--trials", "2", "--processes", "3", "--sensor", "radar", "--write"])
    ((outcome, path),) = asked["written"]
    assert path == TUNED_FILE
    assert (outcome.tracker, len(outcome.found.trials)) == ("oracle-kalman", 2)
    assert outcome.found.trials[0].options == default_options("oracle-kalman")
    assert outcome.command == (
        "python -m harness.lab.tuning.search --tracker oracle-kalman --seeds 100:104 --duration 12 "
        "--sensor radar --trials 2 --write"
    )
    assert outcome.recordings == [
        {
            "density": density, "seed": seed, "duration_s": duration_s, "sensor": "radar", "broken_down": broken_down,
            "hard_share": hard_share,
        }
        for seed in (100, 101, 102, 103)
        for density, duration_s, broken_down, hard_share in (
            (20.0, 12.0, 0, 0.0), (45.0, 12.0, 0, 0.0), (10.0, 30.0, 1, 0.3), (10.0, 30.0, 3, 0.3),
        )
    ]  # fmt: skip


def test_all_are_all_trackers_that_have_a_space(asked):
    main(["--tracker", "all", "--trials", "1", "--seeds", "100:101"])
    assert [tracker for tracker, _ in asked["followed"]] == [each for each in SEARCH_SPACES for _ in range(4)]


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
        (["--tracker", "pmbm", "--seeds", "0:3"], "--seeds 0:3: tuning is done on seeds from 100 to 199 only"),
        (["--tracker", "pmbm", "--seeds", "99:101"], "--seeds 99:101: tuning is done on seeds from 100 to 199 only"),
        (["--tracker", "pmbm", "--seeds", "150:150"], "--seeds 150:150: tuning is done on seeds from 100 to 199 only"),
        (["--tracker", "pmbm", "--seeds", "199:201"], "--seeds 199:201: tuning is done on seeds from 100 to 199 only"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(asked, words, problem, capsys):
    with pytest.raises(SystemExit) as refused:
        main(words)
    assert refused.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1] == f"python -m harness.lab.tuning.search: error: {problem}"
    assert asked["followed"] == []


def test_without_optuna_the_command_ends_before_anything_is_recorded(asked, capsys, monkeypatch):
    def missing():
        raise InputError("tuning needs Optuna, which is not installed: pip install '.[tuning]'")

    monkeypatch.setattr(search, "check_installed", missing)
    with pytest.raises(SystemExit) as refused:
        main(["--tracker", "pmbm"])
    assert refused.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith("pip install '.[tuning]'")


def test_the_first_and_the_last_tuning_seed_may_be_used(asked):
    main(["--tracker", "oracle-kalman", "--trials", "1", "--seeds", "100:200"])
    assert [each.seed for _, each in asked["followed"]] == [seed for seed in range(100, 200) for _ in range(4)]


class Executor:
    """A pool of processes that is this one."""

    made: list[tuple]

    def __init__(self, workers: int, context) -> None:
        Executor.made.append((workers, context.get_start_method()))

    def __enter__(self) -> Executor:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def map(self, work, names):
        assert isinstance(work, partial)  # which processes can be sent
        return map(work, names)


@pytest.mark.parametrize(("processes", "workers"), [(2, 2), (5, 3)])
def test_trackers_are_dealt_out_to_processes_of_one_thread(processes, workers, monkeypatch, asked, capsys):
    Executor.made = []
    for name in ONE_THREAD:
        monkeypatch.setenv(name, "8")
    monkeypatch.setattr(search, "ProcessPoolExecutor", Executor)
    names = "pmbm,imm-gnn,oc-sort"
    main(["--tracker", names, "--trials", "1", "--seeds", "100:101", "--processes", str(processes)])
    assert [os.environ[name] for name in ONE_THREAD] == ["1"] * len(ONE_THREAD)
    assert Executor.made == [(workers, "spawn")]
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()] == names.split(",")


def test_a_recording_is_followed_by_the_tracker_with_its_options_and_none_of_its_tuned_ones(monkeypatch):
    looks = looking_at(SteadyTraffic(steps=8, cars_per_lane=2))(search.RunConfig()).kept()
    monkeypatch.setattr(search, "_looks", lambda recording: looks if recording == RECORDINGS[1] else None)
    options = {"confirm_detections": 2, "doubtful.on": True}
    scores = follow("imm-gnn", options, RECORDINGS[1])
    build = partial(build_tracker, "imm-gnn", options=nested(options), tuned=False)
    tables = track(looks, build, 101)
    expected = score_run(tables.truth, tables.detections, tables.tracks, 101).metrics
    assert repr(scores) == repr(Scores.of(expected))
    assert expected["mot"]["hota"] > 0.0


def test_a_recording_is_of_us101_at_its_density_seed_length_and_sensor(monkeypatch):
    opened: list = []

    class Looks:
        def kept(self) -> str:
            return "kept"

    monkeypatch.setattr(search, "open_looks", lambda config: opened.append(config) or Looks())
    search._looks.cache_clear()
    try:
        assert [search._looks(Recording(45.0, 107, 12.5, "radar")) for _ in range(2)] == ["kept"] * 2
        search._looks(Recording(10.0, 107, 12.5, "radar", broken_down=2, hard_share=0.4))
    finally:
        search._looks.cache_clear()
    config, broken = opened
    assert (config.traffic.broken_down, config.sensor.overrides) == (0, {})
    assert (broken.traffic.broken_down, broken.sensor.profile) == (2, "radar")
    assert broken.sensor.overrides == {"detectability_share": 0.4, **HARD_TO_DETECT}
    assert (config.seed, config.sensor.profile) == (107, "radar")
    assert (config.traffic.net, config.traffic.density, config.traffic.duration_s) == ("us101", 45.0, 12.5)


def test_vehicles_that_are_hard_to_detect_are_seen_in_about_35_to_60_percent_of_scans():
    settings = sensor_settings("lidar", {"detectability_share": 1.0, **HARD_TO_DETECT})
    factor = drawn_factors(settings, 10_000, np.random.default_rng(0))
    assert np.quantile(settings.detection_probability * factor, (0.05, 0.95)) == pytest.approx((0.35, 0.6), abs=0.03)
