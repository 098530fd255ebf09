from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path

import pytest

from harness.grid import tuning
from harness.grid.tuning import Followed, Recording, follow_all, main, mean_scores, tune
from harness.grid.tuning_file import Outcome, write_outcome
from harness.grid.tuning_search import Scores, Trial, best_of, search
from harness.grid.tuning_spaces import ALWAYS, SEARCH_SPACES, default_options, ladders, nested
from harness.trackers.catalogue import TUNED_FILE, available_trackers, tracker_options

LADDERS = {"a": [0, 1, 2, 3], "b": [0, 1, 2, 3], "c": ["no", "yes"]}


def trial(options: dict[str, object], score: float) -> Trial:
    return Trial(dict(options), Scores(score, score))


def distance_to_the_corner(options: dict[str, object]) -> Trial:
    return trial(options, -abs(options["a"] - 3) - abs(options["b"] - 0) - (options["c"] == "no"))


def test_the_search_climbs_to_the_best_value_of_each_setting():
    trials = search({"a": 1, "b": 2, "c": "no"}, LADDERS, distance_to_the_corner, 12)
    assert best_of(trials).options == {"a": 3, "b": 0, "c": "yes"}


@pytest.mark.parametrize("score", [distance_to_the_corner, lambda options: trial(options, 0.0)])
@pytest.mark.parametrize("budget", [1, 5, 24])
def test_each_search_uses_its_budget_up_and_tries_nothing_twice(score, budget: int):
    trials = search({"a": 1, "b": 2, "c": "no"}, LADDERS, score, budget)
    tried = {json.dumps(each.options, sort_keys=True) for each in trials}
    assert len(trials) == len(tried) == budget


def test_a_search_without_a_slope_still_tries_all_there_is():
    assert len(search({"a": 1, "b": 2, "c": "no"}, LADDERS, lambda options: trial(options, 0.0), 32)) == 32


def test_a_search_ends_when_there_is_nothing_left_to_try():
    assert len(search({"a": 1}, {"a": [0, 1, 2]}, lambda options: trial(options, 0.0), 24)) == 3


def test_later_passes_use_what_earlier_ones_found():
    def both_or_neither(options: dict[str, object]) -> Trial:
        return trial(options, options["b"] + (options["a"] if options["b"] > 1 else -options["a"]))

    assert best_of(search({"a": 1, "b": 0}, {"a": [0, 1, 2], "b": [0, 1, 2]}, both_or_neither, 9)).options == {
        "a": 2,
        "b": 2,
    }


def test_every_tracker_has_a_space_of_options_that_it_takes_and_starts_at_its_defaults():
    assert set(SEARCH_SPACES) == set(available_trackers()) - {"detections"}
    for tracker in SEARCH_SPACES:
        steps, start, settings = ladders(tracker), default_options(tracker), tracker_options(tracker)
        assert settings.model_validate(nested(start)) == settings()
        for option, values in steps.items():
            assert start[option] in values
            assert len(values) == len({str(value) for value in values})
            for value in values:
                settings.model_validate(nested({**ALWAYS.get(tracker, {}), option: value}))


def test_the_usual_budget_reaches_every_setting_of_every_space():
    for tracker, space in SEARCH_SPACES.items():
        trials = search(default_options(tracker), ladders(tracker), lambda options: trial(options, 0.0), tuning.TRIALS)
        moved = {name for each in trials for name in space if each.options[name] != trials[0].options[name]}
        assert moved == set(space), tracker


def test_particles_are_no_setting_to_tune():
    assert not any("particles" in option for space in SEARCH_SPACES.values() for option in space)


def test_hidden_vehicles_count_in_the_objective_where_they_are_measured():
    metrics = {"mot": {"hota": 90.0, "idf1": 94.0}, "mae": {"visible_m": None}}
    assert Trial({}, Scores.of(metrics)).objective == 92.0
    hidden = {"hidden_cost_m": 4.0, "false_hidden_tracks_per_scan": 0.5}
    assert Trial({}, Scores.of(metrics | {"hidden": hidden})).objective == 92.0 - 20.0 - 1.0


def test_a_recording_without_hidden_vehicles_says_nothing_of_them():
    followed = [Followed(Scores(90.0, 80.0, cost), 1.0) for cost in (2.0, math.nan, 4.0)]
    mean = mean_scores(followed)
    assert (mean.hota, mean.hidden_cost_m) == (90.0, 3.0)
    assert math.isnan(mean.false_hidden_tracks_per_scan)


def test_the_tracker_is_asked_for_nested_options(monkeypatch: pytest.MonkeyPatch):
    asked: list[dict[str, object]] = []
    monkeypatch.setattr(tuning, "_follow", lambda tracker, options, recording: asked.append(options))
    follow_all(
        "stonesoup-jpda-stitched", {"stitching.margin_m": 5.0, "gate_std": 3.0}, (Recording(20.0, 100, 1.0, "lidar"),)
    )
    assert asked == [{"coarse_gate": True, "stitching": {"margin_m": 5.0}, "gate_std": 3.0}]


def test_every_trial_of_a_tracker_is_scored_by_what_follows_the_recordings(capsys: pytest.CaptureFixture[str]):
    trials = tune("oracle-kalman", 12, lambda tracker, options: Scores(100.0 - options["lon_noise"], 100.0))
    assert best_of(trials).options["lon_noise"] == 0.1
    assert len(capsys.readouterr().err.splitlines()) == len(trials) == 12


RECORDINGS = ({"density": 20.0, "seed": 100, "duration_s": 20.0, "sensor": "lidar"},)


def test_the_written_outcome_reads_back_and_leaves_other_trackers_alone(tmp_path: Path):
    path = tmp_path / "tuned.toml"
    for value in (1.0, 2.0):
        trials = [trial({"lon_noise": 9.0, "stitching.margin_m": 3.0, "detection_probability": None}, 1.0)]
        trials.append(trial({"lon_noise": value, "stitching.margin_m": 5.0, "detection_probability": None}, 91.0))
        write_outcome(Outcome("stonesoup-jpda-stitched", "python -m x", RECORDINGS, trials), path)
        write_outcome(
            Outcome("mmpf", "python -m x", RECORDINGS, [trial({"joint.existence.confirm_hits": 3}, 99.0)]), path
        )
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    stitched = tables["stonesoup-jpda-stitched"]
    assert stitched["options"] == {"lon_noise": 2.0, "stitching": {"margin_m": 5.0}}
    assert (stitched["objective_before"], stitched["objective"], stitched["budget"]) == (1.0, 91.0, 2)
    assert (stitched["recordings"], stitched["command"]) == (list(RECORDINGS), "python -m x")
    assert [each["objective"] for each in stitched["trials"]] == [1.0, 91.0]
    assert tables["mmpf"]["found"] == {"joint": {"existence": {"confirm_hits": 3}}}
    assert "options" not in tables["mmpf"]


@pytest.mark.parametrize("seeds", ["0:3", "99:101", "199:201", "102:102", "many"])
def test_tuning_on_seeds_that_are_reported_on_is_refused(seeds: str, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as refusal:
        main(["--tracker", "oracle-kalman", "--seeds", seeds])
    assert refusal.value.code == 2
    assert f"--seeds {seeds}" in capsys.readouterr().err


@pytest.mark.parametrize(
    "wrong",
    [["--tracker", "kalmann"], ["--tracker", "mmpf", "--trials", "0"], ["--tracker", "mmpf", "--processes", "0"]],
)
def test_a_wrong_tracker_or_budget_is_refused(wrong: list[str], capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as refusal:
        main(wrong)
    assert refusal.value.code == 2
    assert wrong[-2] in capsys.readouterr().err


def test_the_committed_outcome_is_the_best_of_its_own_trials_on_tuning_seeds():
    tables = tomllib.loads(TUNED_FILE.read_text(encoding="utf-8"))
    assert set(tables) <= set(SEARCH_SPACES)
    for table in tables.values():
        if "same_as" in table:
            assert table["options"] == tables[table["same_as"]]["options"]
            continue
        best = max(table["trials"], key=lambda each: each["objective"])
        found = {name: value for name, value in best.items() if name != "objective"}
        assert found == table.get("options", table.get("found"))
        assert all(100 <= recording["seed"] < 200 for recording in table["recordings"])
        assert {recording["density"] for recording in table["recordings"]} == {20.0, 45.0}
