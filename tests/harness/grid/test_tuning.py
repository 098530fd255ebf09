from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from harness.grid import tuning
from harness.grid.tuning import SAME_AS, SEARCH_SPACES, STARTS, Trial, main, tune, write_outcome
from harness.trackers.catalogue import TUNED_FILE, available_trackers


def pretend_to_try(monkeypatch: pytest.MonkeyPatch, score) -> None:
    monkeypatch.setattr(
        tuning, "try_options", lambda tracker, options, recordings: Trial(dict(options), score(options), 50.0, 1.0)
    )


def test_the_search_climbs_to_the_best_value_of_each_setting(monkeypatch: pytest.MonkeyPatch):
    pretend_to_try(monkeypatch, lambda o: -abs(o["lon_noise"] - 3.0) - abs(o["lat_noise"] - 0.01))
    trials = tune("oracle-kalman", [])
    best = max(trials, key=lambda trial: trial.objective)
    assert best.options == {"lon_noise": 3.0, "lat_noise": 0.01, "longest_unseen_s": 10.0}


def test_no_setting_is_tried_twice(monkeypatch: pytest.MonkeyPatch):
    pretend_to_try(monkeypatch, lambda options: 0.0)
    tried = [tuple(trial.options.items()) for trial in tune("stonesoup-jpda", [])]
    assert (
        len(tried) == len(set(tried)) == 1 + sum(len(values) - 1 for values in SEARCH_SPACES["stonesoup-jpda"].values())
    )


def test_every_search_starts_inside_its_space_and_leaves_nothing_to_earlier_tuning():
    for tracker, space in SEARCH_SPACES.items():
        assert set(space) <= set(STARTS[tracker])
        assert all(STARTS[tracker][option] in values for option, values in space.items())


def test_the_written_outcome_reads_back_and_leaves_other_trackers_alone(tmp_path: Path):
    path = tmp_path / "tuned.toml"
    for value in (1.0, 2.0):
        trials = [
            Trial({"lon_noise": value, "motion": "cv"}, 90.0, 92.0, 1.0),
            Trial({"lon_noise": 9.0}, 1.0, 1.0, 1.0),
        ]
        write_outcome("stonesoup-jpda", trials, [], path)
        write_outcome("oracle-kalman", [Trial({"lon_noise": 0.1}, 99.0, 99.0, 1.0)], [], path)
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    assert tables["stonesoup-jpda"]["options"] == {"lon_noise": 2.0, "motion": "cv"}
    assert tables["stonesoup-jpda-stitched"]["options"] == tables["stonesoup-jpda"]["options"]
    assert tables["stonesoup-jpda"]["objective"] == 91.0
    assert [trial["objective"] for trial in tables["stonesoup-jpda"]["trials"]] == [91.0, 1.0]
    assert tables["oracle-kalman"]["options"] == {"lon_noise": 0.1}


@pytest.mark.parametrize("seeds", ["0:3", "99:101", "199:201", "102:102", "many"])
def test_tuning_on_seeds_that_are_reported_on_is_refused(seeds: str, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as refusal:
        main(["--tracker", "oracle-kalman", "--seeds", seeds])
    assert refusal.value.code == 2
    assert f"--seeds {seeds}" in capsys.readouterr().err


def test_the_committed_outcome_is_the_best_of_its_own_trials_on_tuning_seeds():
    tables = tomllib.loads(TUNED_FILE.read_text(encoding="utf-8"))
    assert {*SEARCH_SPACES, *SAME_AS} == set(tables) == set(available_trackers()) - {"mmpf"}
    for tracker, table in tables.items():
        if tracker in SAME_AS:
            assert table["options"] == tables[SAME_AS[tracker]]["options"]
            continue
        best = max(table["trials"], key=lambda trial: trial["objective"])
        assert {name: value for name, value in best.items() if name != "objective"} == table["options"]
        assert all(100 <= recording["seed"] < 200 for recording in table["recordings"])
        assert {recording["density"] for recording in table["recordings"]} == {20.0, 45.0}
