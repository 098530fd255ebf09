"""The command that tunes: what it asks for, follows and writes, over traffic that is made up."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.config.model import SensorConfig
from harness.lab.tuning import search
from harness.lab.tuning.search import HARD_TO_DETECT, Recording, follow, main, refusal
from harness.lab.tuning.spaces import SEARCH_SPACES, Range, default_options, nested
from harness.lab.tuning.trials import Trial, best_of, scores_of
from harness.scoring.score import score_run
from harness.sensor.failings import drawn_factors
from harness.sensor.profiles import sensor_settings
from harness.trackers.catalogue import TUNED_FILE, build_tracker
from tests.harness.stand_ins import SteadyTraffic, looking_at, track


def scored(hota: float, idf1: float) -> dict[str, float]:
    return {"hota": hota, "idf1": idf1}


RECORDINGS = [Recording(20.0, 100 + seed, 1.0, "lidar") for seed in range(3)]


@pytest.fixture
def asked(monkeypatch) -> dict:
    """Let nothing be followed: what is asked for is noted, and a score is made up of the options."""
    noted: dict = {"followed": [], "written": []}

    def followed(tracker, options, recording):
        noted["followed"].append((tracker, recording))
        return scored(50.0 + options.get("lon_noise", 0.0), 60.0)

    monkeypatch.setattr(search, "follow", followed)
    monkeypatch.setattr(search, "refusal", lambda tracker, options: "")
    monkeypatch.setattr(search, "write_outcome", lambda *outcome: noted["written"].append(outcome))
    return noted


def test_each_tracker_is_tried_on_all_recordings_and_told_in_a_line(monkeypatch, capsys):
    searched: list = []

    def tune(tracker, batches, budget):
        searched.append((tracker, batches, budget))
        return [
            Trial({"lon_noise": 1.0}, scored(51.0, 60.0), 2),
            Trial({"lon_noise": 3.0, "gate_std": 2.0}, scored(53.0, 60.0), 2),
            Trial({"lon_noise": 2.0}, scored(59.0, 60.0), 1, stopped=True),
            Trial({"lon_noise": 2.5}, batches=0, refused="it lost a car"),
        ]

    monkeypatch.setattr(search, "tune", tune)
    monkeypatch.setattr(search, "space_of", lambda tracker: {"lon_noise": Range(0.3, 3.0), "gate_std": Range(1.0, 3.0)})
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


def test_a_setting_that_fails_a_check_is_refused_before_it_follows_anything(asked, capsys, monkeypatch):
    monkeypatch.setattr(search, "refusal", refusal)
    monkeypatch.setattr(search, "starts_of", lambda tracker: [{"confirm_detections": n} for n in (1000, 3)])
    monkeypatch.setattr(search, "space_of", lambda tracker: {"confirm_detections": Range(1, 10, whole=True)})
    found = search.tune("oracle-kalman", [RECORDINGS], 2)
    never_confirmed, usual = found
    checks = [finding.partition(":")[0] for finding in never_confirmed.refused.split("; ")]
    assert checks[:2] == ["one_car_becomes_one_confirmed_track", "identities_stay_with_their_cars"]
    assert "0 confirmed tracks of one car; " in never_confirmed.refused
    assert (usual.refused, best_of(found)) == ("", usual)
    assert len(asked["followed"]) == len(RECORDINGS)
    assert " refused for one_car_becomes" in capsys.readouterr().err.splitlines()[0]


def test_a_tracker_that_passes_with_no_setting_is_told_in_one_line(asked, capsys, monkeypatch):
    monkeypatch.setattr(search, "refusal", lambda tracker, options: "its cars swap")
    with pytest.raises(SystemExit) as ended:
        main(["--tracker", "oracle-kalman", "--trials", "8", "--write"])
    assert (ended.value.code, asked["followed"], asked["written"]) == (2, [], [])
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.endswith("every setting was refused, the first one for its cars swap; fix the tracker")


def test_the_usual_search_of_a_tracker_finds_better_settings(asked, capsys):
    main(["--tracker", "oracle-kalman", "--trials", "32"])
    out, err = capsys.readouterr()
    assert len(err.splitlines()) == 32
    assert "stopped after 1" in err
    assert out.startswith("oracle-kalman: 55.50 -> ")
    assert 59.0 < float(out.split()[3]) <= 60.0  # what the largest noise of its range gives


def test_what_was_found_is_written_with_the_command_that_finds_it_again(asked):
    main(["--tracker", "oracle-kalman", "--trials", "2", "--processes", "3", "--sensor", "radar", "--write"])
    ((path, tracker, command, recordings, trials, space),) = asked["written"]
    assert (path, tracker, len(trials)) == (TUNED_FILE, "oracle-kalman", 2)
    assert (trials[0].options, set(space)) == (default_options("oracle-kalman"), set(trials[0].options))
    assert command == (
        "python -m harness.lab.tuning.search --tracker oracle-kalman --seeds 100:104 --duration 12 "
        "--sensor radar --trials 2 --write"
    )
    assert [each["seed"] for each in recordings] == [seed for seed in (100, 101, 102, 103) for _ in range(4)]


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
        (["--tracker", "pmbm", "--seeds", "0:3"], "--seeds 0:3: tuning is done on seeds from 100 to 199 only"),
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

    monkeypatch.setattr(search, "load_optuna", missing)
    with pytest.raises(SystemExit) as refused:
        main(["--tracker", "pmbm"])
    assert refused.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith("pip install '.[tuning]'")


def test_a_recording_is_followed_by_the_tracker_with_its_options_and_none_of_its_tuned_ones(monkeypatch):
    looks = looking_at(SteadyTraffic(steps=8, cars_per_lane=2))(search.RunConfig()).kept()
    monkeypatch.setattr(search, "_looks", lambda recording: looks if recording == RECORDINGS[1] else None)
    options = {"confirm_detections": 2, "doubtful.on": True}
    scores = follow("oc-sort", options, RECORDINGS[1])
    build = partial(build_tracker, "oc-sort", options=nested(options), tuned=False)
    tables = track(looks, build, 101)
    expected = score_run(tables.truth, tables.detections, tables.tracks, 101).metrics
    assert scores == scores_of(expected)
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
