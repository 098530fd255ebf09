from __future__ import annotations

import math
import sys
import tomllib
from pathlib import Path

import pytest

from harness.common.errors import InputError
from harness.lab.tuning import spaces
from harness.lab.tuning.spaces import (
    ALWAYS,
    SEARCH_SPACES,
    Range,
    default_options,
    flat,
    is_searched,
    nested,
    space_of,
    starts_of,
)
from harness.lab.tuning.trials import (
    Trial,
    best_of,
    ends_near,
    load_optuna,
    mean_of,
    scores_of,
    search,
    write_outcome,
)
from harness.trackers.catalogue import TUNED_FILE, available_trackers, tracker_options

SPACE = {"a": Range(0.0, 10.0), "b": Range(0.01, 100.0, log=True), "n": Range(1, 9, whole=True), "c": ("no", "yes")}
START = {"a": 1.0, "b": 10.0, "n": 8, "c": "no"}


def both(value: float, **more: float) -> dict[str, float]:
    return {"hota": value, "idf1": value, **more}


def scored(value: float) -> list[dict[str, float]]:
    return [both(value)]


def near_a_place(options: dict[str, object], batch: int = 0) -> list[dict[str, float]]:
    """Best at a = 4, b = 1, n = 3, c = yes."""
    off = abs(options["a"] - 4.0) + abs(math.log(options["b"])) + abs(options["n"] - 3) + 2.0 * (options["c"] == "no")
    return scored(50.0 - off)


def quietly(trial: Trial) -> None:
    """Tell nobody."""


def test_the_search_comes_near_the_best_setting():
    found = search([START], SPACE, near_a_place, 1, 64, quietly)
    assert near_a_place(START)[0]["hota"] == pytest.approx(37.7, abs=0.1)
    assert best_of(found).objective > 48.0
    assert best_of(found).options["c"] == "yes"


@pytest.mark.parametrize("budget", [1, 2, 5, 24])
def test_each_search_begins_at_the_start_and_uses_its_budget_up(budget: int):
    trials = search([START], SPACE, near_a_place, 2, budget, quietly)
    assert len(trials) == budget
    assert trials[0] == Trial(START, both(trials[0].objective), 2)


def test_a_trial_keeps_most_of_the_best_setting_and_all_of_what_it_is_told_to_begin_with():
    other = {"a": 3.0, "b": 2.0, "n": 4, "c": "yes"}
    space = SPACE | {f"k{k}": Range(0.0, 1.0) for k in range(20)}
    start = START | {f"k{k}": 0.5 for k in range(20)}
    follow = lambda options, batch: scored(1.0 if options == start else 0.0)  # noqa: E731
    trials = search([start, other], space, follow, 1, 42, quietly)
    assert [trial.options for trial in trials[:2]] == [start, other]
    kept = [sum(trial.options[key] == start[key] for key in start) for trial in trials[2:]]
    assert 0.6 * len(start) < sum(kept) / len(kept) < 0.85 * len(start)
    assert max(kept) < len(start)


def test_what_a_setting_leaves_to_the_trackers_defaults_is_mostly_left_so():
    follow = lambda options, batch: scored(1.0 - len(options))  # noqa: E731
    tried = search([{}], {name: Range(0.0, 1.0) for name in "abcdef"}, follow, 1, 40, quietly)
    assert sum(len(trial.options) for trial in tried) < 0.5 * 6 * len(tried)


def test_the_same_search_tries_the_same_settings():
    once, again = (search([START], SPACE, near_a_place, 2, 20, quietly) for _ in range(2))
    assert once == again


def test_every_setting_lies_in_its_range_and_has_three_digits():
    for trial in search([START], SPACE, near_a_place, 1, 20, quietly):
        assert all(
            values.holds(trial.options[key]) if isinstance(values, Range) else trial.options[key] in values
            for key, values in SPACE.items()
        )
        assert all(float(f"{trial.options[key]:.3g}") == trial.options[key] for key in ("a", "b"))
        assert isinstance(trial.options["n"], int)


def test_what_is_behind_is_stopped_and_never_the_best():
    asked: list[tuple[float, int]] = []

    def follow(options: dict[str, object], batch: int) -> list[dict[str, float]]:
        asked.append((options["a"], batch))
        return scored(options["a"])

    found = search([{"a": 5.0}], {"a": Range(0.0, 10.0)}, follow, 4, 40, quietly)
    stopped = [trial for trial in found if trial.stopped]
    assert 3 <= len(stopped) < 40
    assert {trial.batches for trial in stopped} <= {1, 2, 3}
    assert {trial.batches for trial in found if not trial.stopped} == {4}
    assert len(asked) == sum(trial.batches for trial in found) < 4 * 40
    assert best_of(found).objective == max(trial.objective for trial in found if not trial.stopped)
    assert best_of([Trial({}, both(1.0)), Trial({}, both(2.0), stopped=True)]).objective == 1.0


def test_a_refused_setting_is_never_followed_and_never_the_best():
    followed: list[float] = []

    def follow(options: dict[str, object], batch: int) -> list[dict[str, float]]:
        followed.append(options["a"])
        return scored(options["a"])

    def refusal(options: dict[str, object]) -> str:
        return "too large" if options["a"] >= 6.0 else ""

    space = {"a": Range(0.0, 10.0)}
    trials = search([{"a": 9.0}, {"a": 2.0}], space, follow, 1, 40, quietly, refusal)
    refused = [trial for trial in trials if trial.refused]
    assert trials[0].refused == "too large"
    assert len(refused) + len(followed) == len(trials) == 40
    assert {(trial.batches, trial.refused, trial.options["a"] >= 6.0) for trial in refused} == {(0, "too large", True)}
    assert 5.0 < best_of(trials).objective == max(followed) < 6.0


def test_a_trial_is_scored_by_the_mean_over_all_recordings_of_its_batches():
    values = [[10.0, 20.0], [60.0]]

    def follow(options: dict[str, object], batch: int) -> list[dict[str, float]]:
        return [both(value) for value in values[batch]]

    (trial,) = search([{"a": 1.0}], {"a": Range(0.0, 2.0)}, follow, 2, 1, quietly)
    assert trial.scores["hota"] == 30.0


def test_the_defaults_may_lie_outside_the_ranges():
    found = search([{"a": 50.0}], {"a": Range(0.0, 10.0)}, lambda options, batch: scored(1.0), 1, 3, quietly)
    assert found[0].options["a"] == 50.0
    assert len(found) == 3


@pytest.mark.parametrize(
    ("values", "value", "end"),
    [
        (Range(0.0, 10.0), 0.5, "low"),
        (Range(0.0, 10.0), 0.6, None),
        (Range(0.0, 10.0), 9.5, "high"),
        (Range(0.0, 10.0), 30.0, "high"),
        (Range(0.01, 100.0, log=True), 0.015, "low"),
        (Range(0.01, 100.0, log=True), 0.02, None),
        (Range(0.01, 100.0, log=True), 70.0, "high"),
        (Range(1, 9, whole=True), 9, "high"),
        (Range(1, 9, whole=True), 2, None),
    ],
)
def test_a_value_within_five_percent_of_an_end_lies_at_it(values: Range, value: float, end: str | None):
    assert values.end_near(value) == end
    assert ends_near({"x": value}, {"x": values}) == ({} if end is None else {"x": end})
    assert ends_near({"x": "overlap"}, {"x": ("overlap", "distance")}) == {}


def test_a_group_that_is_switched_off_is_not_searched():
    assert is_searched("gate_std", {"doubtful.on": False})
    assert is_searched("doubtful.on", {"doubtful.on": False})
    assert is_searched("doubtful.flow_mps", {"doubtful.on": True})
    assert not is_searched("doubtful.flow_mps", {"doubtful.on": False})
    space = {"x.on": (False, True), "x.a": Range(0.0, 1.0)}
    tried = search([{"x.on": False}], space, lambda options, batch: scored(len(options)), 1, 20, quietly)
    assert all(("x.a" in trial.options) == trial.options["x.on"] for trial in tried)
    assert {trial.options["x.on"] for trial in tried} == {False, True}


def test_the_settings_of_a_group_that_is_newly_switched_on_are_all_chosen():
    space = {"x.on": (False, True), **{f"x.{name}": Range(0.0, 1.0) for name in "abcdef"}}
    off_is_best = lambda options, batch: scored(0.0 if options["x.on"] else 1.0)  # noqa: E731
    tried = search([{"x.on": False}], space, off_is_best, 1, 40, quietly)
    switched_on = [trial.options for trial in tried if trial.options["x.on"]]
    assert len(switched_on) >= 2
    assert all(set(options) == set(space) for options in switched_on)


def test_without_optuna_one_line_tells_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(InputError, match=r"^tuning needs Optuna, which is not installed: pip install '.\[tuning\]'$"):
        load_optuna()


def test_every_tracker_has_a_space_of_options_that_it_takes_and_starts_at_its_defaults():
    assert set(SEARCH_SPACES) == set(available_trackers()) - {"detections"}
    for tracker in SEARCH_SPACES:
        start, settings = default_options(tracker), tracker_options(tracker)
        assert settings.model_validate(nested(start)) == settings()
        assert len(space_of(tracker)) >= 4
        for option, values in space_of(tracker).items():
            tried = values
            if isinstance(values, Range):
                tried = [int(end) if values.whole else float(end) for end in values[:2]]
            for value in tried:
                settings.model_validate(nested({**ALWAYS.get(tracker, {}), option: value}))


def test_a_search_begins_at_the_defaults_at_what_was_found_before_and_at_that_with_its_switches_on_or_off(monkeypatch):
    found = {"lon_noise": 2.5, "stitching": {"margin_m": 1.0}, "coarse_gate": True}
    monkeypatch.setattr(spaces, "tuned_options", lambda tracker: found)
    defaults, before, switched_on = starts_of("stonesoup-jpda-stitched")
    assert defaults == default_options("stonesoup-jpda-stitched")
    assert before == {"lon_noise": 2.5, "stitching.margin_m": 1.0, "doubtful.on": False}
    assert switched_on == before | {"doubtful.on": True}
    doubting = {"lon_noise": 2.5, "doubtful": {"on": True, "flow_mps": 4.0}}
    monkeypatch.setattr(spaces, "tuned_options", lambda tracker: doubting)
    _, before, switched_off = starts_of("pmbm")
    assert before == {"lon_noise": 2.5, "doubtful.on": True, "doubtful.flow_mps": 4.0}
    assert switched_off == {"lon_noise": 2.5, "doubtful.on": False}
    monkeypatch.setattr(spaces, "tuned_options", lambda tracker: {})
    assert starts_of("oracle-kalman") == [default_options("oracle-kalman")]
    assert starts_of("mmpf") == [default_options("mmpf")]


def test_keys_that_a_tracker_does_not_have_are_passed_over(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(SEARCH_SPACES, "oracle-kalman", {"lon_noise": Range(0.1, 1.0), "not.there": Range(0.0, 1.0)})
    assert set(space_of("oracle-kalman")) == set(default_options("oracle-kalman")) == {"lon_noise"}


def test_dotted_options_and_groups_are_the_same():
    dotted = {"a": 1, "b.c": 2.0, "b.d.e": "x"}
    assert nested(dotted) == {"a": 1, "b": {"c": 2.0, "d": {"e": "x"}}}
    assert flat(nested(dotted)) == dotted


def test_particles_are_no_setting_to_tune():
    assert not any("particles" in option for space in SEARCH_SPACES.values() for option in space)


def test_every_rival_may_doubt_what_stands_and_none_doubts_what_stands_in_the_egos_path():
    for tracker, space in SEARCH_SPACES.items():
        assert ("doubtful.on" in space) == (tracker not in {"mmpf", "oracle-kalman"})
        assert not {"doubtful.path_half_width_m", "doubtful.path_ahead_m"} & set(space)


def test_hidden_vehicles_and_withheld_ones_count_in_the_objective_where_they_are_measured():
    def objective(**groups):
        return Trial({}, scores_of({"mot": {"hota": 90.0, "idf1": 94.0}, **groups})).objective

    hidden = {"hidden_cost_m": 4.0, "false_hidden_tracks_per_scan": 0.5}
    assert objective() == 92.0
    assert objective(hidden=hidden) == 92.0 - 20.0 - 1.0
    assert objective(hidden=hidden, in_plain_view={"recall": None}) == 92.0 - 20.0 - 1.0
    assert objective(in_plain_view={"recall": 97.0, "stopped_recall": 80.0}) == 92.0 - 3.0 - 10.0


def test_a_recording_without_hidden_vehicles_says_nothing_of_them():
    mean = mean_of([both(90.0, hidden_cost_m=2.0), both(90.0), both(90.0, hidden_cost_m=4.0)])
    assert mean == both(90.0, hidden_cost_m=3.0)


RECORDINGS = ({"density": 20.0, "seed": 100, "duration_s": 20.0, "sensor": "lidar"},)


def test_the_written_outcome_reads_back_and_leaves_other_trackers_alone(tmp_path: Path):
    path = tmp_path / "tuned.toml"
    path.write_text("# tuned\n\n[oc-sort]\nbudget = 2\n")
    space = {"lon_noise": Range(0.5, 2.0), "stitching.margin_m": Range(1.0, 9.0), "association": ("overlap", "other")}
    for value in (1.0, 2.0):
        trials = [
            Trial({"lon_noise": 9.0, "association": "overlap"}, both(1.0), 4),
            Trial({"lon_noise": value, "stitching.margin_m": 5.0, "association": "other"}, both(91.0), 4),
            Trial({"lon_noise": 1.5}, both(99.0), 2, stopped=True),
            Trial({"lon_noise": 3.0}, batches=0, refused='it "lost" a car'),
        ]
        write_outcome(path, "stonesoup-jpda-stitched", "python -m x", RECORDINGS, trials, space)
        write_outcome(path, "mmpf", "python -m x", RECORDINGS, [Trial({"a.b": 3}, both(9.0))], {"a.b": Range(1, 9)})
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    stitched = tables["stonesoup-jpda-stitched"]
    assert path.read_text().startswith("# tuned\n")
    assert tables["oc-sort"] == {"budget": 2}
    assert stitched["options"] == {"lon_noise": 2.0, "stitching": {"margin_m": 5.0}, "association": "other"}
    assert (stitched["objective_before"], stitched["objective"], stitched["budget"]) == (1.0, 91.0, 4)
    assert (stitched["recordings"], stitched["command"]) == (list(RECORDINGS), "python -m x")
    assert [each.get("objective") for each in stitched["trials"]] == [1.0, 91.0, 99.0, None]
    assert (stitched["trials"][2]["stopped_after"], stitched["trials"][3]["refused"]) == (2, 'it "lost" a car')
    assert stitched["at_an_end"] == ["lon_noise"]
    assert stitched["searched"]["stitching"] == {"margin_m": [1.0, 9.0]}
    assert tables["mmpf"]["found"] == {"a": {"b": 3}}
    assert "options" not in tables["mmpf"]


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
