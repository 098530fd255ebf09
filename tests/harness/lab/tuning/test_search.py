"""The search finds a known optimum, counts no refused setting, and writes what it found."""

import math
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from harness.common.errors import InputError
from harness.lab.tuning import search as tuning
from harness.lab.tuning.search import main, mean_of, objective_of, search, write_outcome
from harness.lab.tuning.spaces import SEARCH_SPACES, Range, starts_of
from harness.trackers.catalogue import TUNED_FILE

SPACE = {"gate": Range(0.1, 10.0, log=True), "doubtful.on": (False, True), "doubtful.s": Range(0.0, 3.0)}
START = {"gate": 9.0, "doubtful.on": False, "doubtful.s": 1.0}


def both(value, **others):
    return {"hota": value, "idf1": value, **others}


def bowl(options, batch):
    """Best, 90, at a gate of 1 with the doubt switched on and 2 s."""
    doubt = -abs(options["doubtful.s"] - 2.0) if options["doubtful.on"] else -5.0
    return [both(90.0 - 10.0 * abs(math.log10(options["gate"])) + doubt)]


def test_the_search_comes_near_a_known_optimum_and_repeats_itself():
    first, second = (search([START], SPACE, bowl, 2, 60) for _ in range(2))
    assert first.trials[0].user_attrs["options"] == {"gate": 9.0, "doubtful.on": False}
    assert first.best_value > 88.0
    assert first.best_trial.user_attrs["options"] == second.best_trial.user_attrs["options"]


def test_a_refused_setting_never_wins():
    def refused(options):
        return "its cars swap" if options["doubtful.on"] else ""

    study = search([START], SPACE, bowl, 1, 30, refused)
    assert not study.best_trial.user_attrs["options"]["doubtful.on"]
    with pytest.raises(InputError, match="the first one for its cars swap"):
        search([START], SPACE, bowl, 1, 3, lambda options: "its cars swap")


def test_a_setting_that_is_behind_is_not_followed_to_the_end():
    followed = []
    study = search([START], SPACE, lambda options, batch: followed.append(batch) or bowl(options, batch), 4, 20)
    assert len(followed) < 4 * 20
    assert study.best_trial.state.name == "COMPLETE"


def test_hidden_errors_false_hidden_tracks_and_withheld_vehicles_cost():
    hidden = {"hidden_cost_m": 4.0, "false_hidden_tracks_per_scan": 0.5}
    assert objective_of({"hota": 90.0, "idf1": 94.0}) == 92.0
    assert objective_of(both(92.0, **hidden)) == 92.0 - 20.0 - 1.0
    assert objective_of(both(92.0, plain_view_recall=97.0, stopped_recall=80.0)) == 92.0 - 3.0 - 10.0


def test_a_recording_without_hidden_vehicles_says_nothing_of_them():
    mean = mean_of([both(90.0, hidden_cost_m=2.0), both(90.0), both(90.0, hidden_cost_m=4.0)])
    assert mean == both(90.0, hidden_cost_m=3.0)


def test_the_written_outcome_reads_back_and_leaves_other_trackers_alone(tmp_path: Path):
    path = tmp_path / "tuned.toml"
    path.write_text("[oc-sort]\nbudget = 2\n")
    study = search([START], SPACE, bowl, 2, 8)
    write_outcome(path, "pmbm", "python -m x", [{"seed": 100}], study, SPACE)
    write_outcome(path, "mmpf", "python -m x", [{"seed": 100}], study, SPACE)
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    best = study.best_trial.user_attrs["options"]
    assert tables["oc-sort"] == {"budget": 2}
    assert tables["pmbm"]["options"]["gate"] == tables["mmpf"]["found"]["gate"] == best["gate"]
    assert tables["pmbm"]["options"]["doubtful"]["on"] == best["doubtful.on"]
    assert "options" not in tables["mmpf"]
    assert (tables["pmbm"]["budget"], len(tables["pmbm"]["trials"]), tables["pmbm"]["objective"]) == (
        8, 8, study.best_value,
    )  # fmt: skip


@pytest.mark.parametrize("tracker", SEARCH_SPACES)
def test_each_search_begins_at_settings_that_the_tracker_has(tracker):
    assert all(start.keys() <= SEARCH_SPACES[tracker].keys() for start in starts_of(tracker))


@pytest.mark.parametrize(
    ("words", "told"),
    [("--tracker nobody", "--tracker nobody"), ("--tracker pmbm --seeds 0:4", "--seeds 0:4"),
     ("--tracker pmbm --seeds 199:201", "--seeds 199:201"), ("--tracker pmbm --trials 0", "--trials")],
)  # fmt: skip
def test_wrong_words_end_with_code_2_and_a_line_that_names_them(words, told, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words.split())
    assert ended.value.code == 2
    assert told in capsys.readouterr().err


def test_the_command_tries_every_recording_and_writes_what_it_found(tmp_path, monkeypatch, capsys):
    followed = []
    monkeypatch.setattr(tuning, "ProcessPoolExecutor", lambda *_: ThreadPoolExecutor(1))
    monkeypatch.setattr(tuning, "TUNED_FILE", tmp_path / "tuned.toml")
    monkeypatch.setattr(tuning, "refusal", lambda tracker, options: "")
    monkeypatch.setattr(tuning, "follow", lambda tracker, options, recording: followed.append(recording) or both(50.0))
    main(["--tracker", "oracle-kalman", "--seeds", "100:101", "--trials", "2", "--write"])
    assert capsys.readouterr().out.startswith("oracle-kalman: 50.00 in 2 trials")
    table = tomllib.loads((tmp_path / "tuned.toml").read_text())["oracle-kalman"]
    assert len(followed) == 2 * len(table["recordings"]) == 8


def test_the_committed_outcome_is_the_best_of_its_own_trials_on_tuning_seeds():
    tables = tomllib.loads(TUNED_FILE.read_text(encoding="utf-8"))
    assert set(tables) <= set(SEARCH_SPACES)
    for table in tables.values():
        best = max(
            (each for each in table["trials"] if not {"stopped_after", "refused"} & set(each)),
            key=lambda each: each["objective"],
        )
        found = {name: value for name, value in best.items() if name != "objective"}
        assert found == table.get("options", table.get("found"))
        assert all(100 <= recording["seed"] < 200 for recording in table["recordings"])
        flowing = [recording for recording in table["recordings"] if not recording.get("broken_down")]
        assert {recording["density"] for recording in flowing} == {20.0, 45.0}


def test_pmbm_and_whoever_doubts_were_tuned_on_broken_down_vehicles_and_keep_nine_in_ten():
    tables = tomllib.loads(TUNED_FILE.read_text(encoding="utf-8"))
    doubting = {name for name, table in tables.items() if table.get("options", {}).get("doubtful", {}).get("on")}
    for table in (tables[name] for name in doubting | {"pmbm"}):
        assert {0, 1, 3} == {recording["broken_down"] for recording in table["recordings"]}
        assert table["stopped_recall"] >= 90.0
        assert table["at_an_end"] == []
