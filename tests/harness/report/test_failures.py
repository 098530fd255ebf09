"""The failures of a run's page: which come first, what is said of each, and where the replay shows it."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from harness.common.errors import InputError
from harness.common.numbers import as_json
from harness.decisions.decide import driver_of
from harness.report import failures
from harness.report.html_tables import mot_table
from harness.report.page import run_page, write_run_page
from harness.report.replay_data import replay_data
from harness.report.summary import print_summary
from harness.report.summary_text import decision_summary
from harness.running.finished import read_recorded_run
from harness.scoring.driving.asked import DriverSetup
from harness.storage import run_folder as runfolder
from harness.storage.tables import write_table
from tests.harness.recorded_scene import rewrite, write_recorded_scene
from tests.harness.scoring.scenes import score_run

ENTRY = {
    "id": "near", "kind": "never reported", "episode": 0, "from_s": 1.0, "to_s": 5.0, "closest_m": 14.6,
    "without_track_s": 4.1, "detected_percent": 36.4,
}  # fmt: skip
BRAKING = {
    "kind": "missed", "episode": 0, "from_step": 30, "to_step": 39, "step": 35, "duration_s": 1.0, "truth_mps2": -4.0,
    "tracks_mps2": 0.5, "vehicle_id": "far", "visibility": "hidden", "unseen_s": 1.5, "track_id": -1, "fate": "lost",
}  # fmt: skip


def event(name, outcome, duration_s=2.0):
    return {
        "vehicle_id": name, "track_id": 1, "outcome": outcome, "from_step": 10, "to_step": 30,
        "duration_s": duration_s, "reacquire_s": np.nan,
    }  # fmt: skip


def errors(**distance_of):
    rows = [
        {"step": step, "vehicle_id": name, "track_id": 1, "lon_error_m": metres, "lat_error_m": 0.0}
        for name, metres in distance_of.items()
        for step in range(10, 31)
    ]
    return pd.DataFrame(rows)


@pytest.fixture
def run(tmp_path):
    """Return the recorded scene, in which one vehicle in plain view is never reported."""
    folder = write_recorded_scene(tmp_path / "run")
    metrics = json.loads((folder / runfolder.METRICS).read_text())
    metrics["in_plain_view"] |= {"never_reported": 1, "dropped": 0, "vehicles": [ENTRY]}
    (folder / runfolder.METRICS).write_text(json.dumps(metrics))
    return read_recorded_run(folder)


@pytest.fixture
def driven(tmp_path):
    """Return the recorded scene, scored with a driver; *far* is given up at 3 s, and a track of nobody stands ahead."""
    folder = write_recorded_scene(tmp_path / "run")
    run = read_recorded_run(folder)
    slow = run.truth.assign(speed_mps=run.truth["speed_mps"].mask(run.truth["vehicle_id"] == "far", 2.0))
    scored = score_run(slow, run.detections, run.tracks, 7, DriverSetup(driver_of("hdm"), run.road))
    metrics = json.loads((folder / runfolder.METRICS).read_text()) | {"decisions": scored.metrics["decisions"]}
    (folder / runfolder.METRICS).write_text(as_json(metrics))
    write_table(scored.commands, folder / runfolder.COMMANDS)
    ghost = BRAKING | {
        "kind": "phantom", "fate": "ghost", "vehicle_id": "", "visibility": "", "unseen_s": np.nan, "track_id": 1,
        "truth_mps2": 0.0, "tracks_mps2": -3.0,
    }  # fmt: skip
    rewrite(folder, runfolder.BRAKINGS, pd.DataFrame([ghost, BRAKING]))
    return folder


def test_lost_and_stolen_tracks_come_first_then_the_largest_error_then_the_longest():
    table = pd.DataFrame(
        [event("kept", "same_id"), event("astray", "survived"), event("stolen", "hijacked"), event("lost", "lost"),
         event("long", "lost", 4.0), event("longer", "lost", 9.0)]
    )  # fmt: skip
    off = errors(kept=20.0, astray=15.0, stolen=3.0, lost=5.0, long=1.0, longer=1.0)
    order = [ranked["vehicle_id"] for ranked in failures.ranked_events(table, off)]
    assert order == ["lost", "stolen", "longer", "long", "astray", "kept"]


def test_only_the_error_of_the_events_own_track_between_the_two_sightings_counts():
    off = errors(car=1.0)
    off.loc[off["step"] == 15, ["lon_error_m", "lat_error_m"]] = [3.0, 4.0]
    off.loc[off["step"] == 16, ["track_id", "lon_error_m"]] = [2, 50.0]
    off.loc[off["step"] == 30, "lon_error_m"] = 60.0
    (chosen,) = failures.ranked_events(pd.DataFrame([event("car", "lost")]), off)
    assert chosen["largest_error_m"] == pytest.approx(5.0)
    (unmeasured,) = failures.ranked_events(pd.DataFrame([event("car", "lost")]), errors(other=1.0))
    assert not re.search("off|nan", failures.occlusion_sentence(unmeasured))


def test_a_withheld_vehicle_comes_before_every_occlusion_and_each_is_replayed(run):
    near, far = failures.failures_of(run).worst
    assert (near.vehicle_id, near.time_s, near.until_s) == ("near", 1.0, 5.5)
    assert (far.vehicle_id, far.time_s, far.until_s) == ("far", 2.0, 4.5)
    assert far.sentence.startswith("far, hidden for 2.0 s: its track 2 was deleted")


@pytest.mark.parametrize(
    ("length_m", "kind", "begins", "ends"),
    [
        (4.5, "never reported", "A car in", "It is near, and never had a track in plain view."),
        (2.2, "dropped", "A two-wheeler in", "It is near, and had a track before that."),
        (12.0, "never reported", "A lorry in", "It is near, and never had a track in plain view."),
        (np.nan, "never reported", "A car in", "It is near, and never had a track in plain view."),
    ],
)
def test_a_withheld_vehicle_is_told_in_a_plain_sentence(length_m, kind, begins, ends):
    told = failures.withheld_sentence(ENTRY | {"kind": kind}, length_m)
    assert told.startswith(begins)
    assert told.endswith(ends)
    assert "plain view at 15 m had no track for 4.1 s; it was detected in 36 % of these scans." in told


def with_vehicles(run, *entries):
    return replace(run, metrics=run.metrics | {"in_plain_view": run.metrics["in_plain_view"] | {"vehicles": entries}})


def test_an_old_run_and_a_vehicle_that_is_not_shown_give_no_withheld_vehicle(run):
    old = replace(run, metrics={key: value for key, value in run.metrics.items() if key != "in_plain_view"})
    assert list(failures.withheld_vehicles(old)) == []
    assert list(failures.withheld_vehicles(with_vehicles(run, ENTRY | {"id": "gone"}, ENTRY | {"to_s": 99.0}))) == []


def test_four_withheld_vehicles_and_five_occlusions_are_shown_and_a_fold_has_every_other_failure(run):
    occlusion = run.events.iloc[[0] * 8].assign(outcome=[*["lost"] * 6, "survived", "same_id"])
    many = replace(with_vehicles(run, *(ENTRY | {"without_track_s": 9.0 - k} for k in range(6))), events=occlusion)
    found = failures.failures_of(many)
    told = [[each.sentence.partition(" s")[0][-3:] for each in part] for part in (found.worst, found.others)]
    assert told == [["9.0", "8.0", "7.0", "6.0", *["2.0"] * 5], ["5.0", "4.0", "2.0", "2.0"]]
    page = run_page(many)
    assert page.partition('id="failures"')[2].count('<button type="button" data-vehicle=') == 13
    assert "<summary>4 more" in page


def test_the_page_says_how_many_are_withheld_and_tells_the_first(run):
    text = write_run_page(run.folder).read_text(encoding="utf-8")
    assert "come first: 1 of 2 vehicles never had a track in plain view; tracks lost: 0." in text
    first = text.index("A car in plain view at 15 m had no track for 4.1 s; it was detected in 36 % of these scans.")
    assert first < text.index("far, hidden for")


def test_the_screen_and_the_page_tell_recall_and_an_old_run_has_none(run, capsys):
    counts = {"never_reported": 1, "dropped": 2, "vehicles_n": 28}
    scores = run.metrics["in_plain_view"] | {"recall": 97.25, "worst_tenth": 12.0} | counts
    known = run.metrics | {"in_plain_view": scores, "mot": run.metrics["mot"] | {"false_tracks": 7, "tracks_n": 450}}
    old = {key: value for key, value in run.metrics.items() if key != "in_plain_view"}
    assert "97.2" in str(mot_table(known))
    assert "<td>7 of 450</td>" in str(mot_table(known)), "a count of false tracks says of how many"
    print_summary(known, run.folder)
    screen = " ".join(capsys.readouterr().err.split())
    assert "97.2 % of the time (worst tenth 12.0 %); 1 of 28 vehicles never got one; tracks lost: 2" in screen
    assert "track-steps without a vehicle 7 of 450" in screen
    assert "worst tenth %" in str(mot_table(old))
    print_summary(old, run.folder, is_log=True)
    told = capsys.readouterr().err
    assert not any(words in told for words in ("In plain view", "the tracker took"))


def test_the_worst_brakings_differ_most_for_longest(driven):
    run = read_recorded_run(driven)
    table = pd.DataFrame([
        BRAKING | {"vehicle_id": "short", "duration_s": 0.5, "truth_mps2": -9.0},
        BRAKING | {"vehicle_id": "long", "duration_s": 4.0, "truth_mps2": -3.0},
        BRAKING | {"vehicle_id": "mild", "duration_s": 0.5, "truth_mps2": -2.0},
    ])  # fmt: skip
    found = failures.brakings_of(replace(run, brakings=pd.concat([table, table], ignore_index=True)))
    names = [each.vehicle_id for each in [*found.worst, *found.others]]
    assert (names, len(found.others)) == (["long", "long", "short", "short", "mild", "mild"], 1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, "Missed braking for far, not detected for 1.5 s: -4.0 m/s² by the truth and 0.5 m/s² by the tracks, "
             "for 1.0 s; its track was deleted."),
        ({"fate": "none", "unseen_s": np.nan}, "never detected"),
        ({"fate": "displaced", "track_id": 4, "unseen_s": 0.0, "visibility": "partial"}, "far, partly hidden: "),
        ({"fate": "displaced", "track_id": 4}, "track 4 follows it, but has another position or speed."),
        ({"fate": "hijacked", "track_id": 4}, "its track 4 is on another vehicle."),
        ({"kind": "phantom", "fate": "ghost", "track_id": 4, "vehicle_id": ""}, "track 4 follows no vehicle."),
        ({"kind": "phantom", "fate": "hijacked", "track_id": 4}, "track 4 went over from another vehicle to far"),
    ],
)  # fmt: skip
def test_a_sentence_tells_who_was_to_blame_for_a_braking_and_why(change, words):
    sentence = failures.braking_sentence(BRAKING | change)
    assert words in sentence
    assert not re.search(r"\{|nan|-1\b", sentence)


def test_the_page_leads_from_a_decision_to_the_replay(driven):
    page = write_run_page(driven).read_text(encoding="utf-8")
    section = page[page.index('<section id="decisions"') :]
    buttons = re.findall(r'data-vehicle="(\w+)" data-time="([\d.]+)" data-until="([\d.]+)"', section)
    assert buttons == [("far", "2.0", "4.4"), ("ego", "2.0", "4.4")]
    assert "once from the truth and once from the tracks" in section


def test_the_replay_plots_what_the_driver_demands(driven):
    labels = [label for label, *_ in replay_data(read_recorded_run(driven))["plots"]]
    assert {"vehicle: demanded_by_truth_mps2", "vehicle: demanded_by_tracks_mps2"} <= set(labels)


def test_a_run_that_asked_no_driver_has_a_page_without_decisions(tmp_path):
    page = write_run_page(write_recorded_scene(tmp_path / "run")).read_text(encoding="utf-8")
    assert 'href="#decisions"' not in page


@pytest.mark.parametrize("change", [{"fate": "eaten"}, {"kind": "other"}, {"from_step": "x"}])
def test_a_broken_table_of_brakings_is_refused_in_one_line(driven, change):
    rewrite(driven, runfolder.BRAKINGS, pd.DataFrame([BRAKING | change]))
    with pytest.raises(InputError, match=r"brakings\.parquet"):
        write_run_page(driven)


def test_the_summary_is_told_without_what_was_not_measured(driven):
    metrics = json.loads((driven / runfolder.METRICS).read_text())
    metrics["decisions"] |= {"missed": 1, "phantom": 0, "lateness_s": 0.4, "onsets": 3}
    assert "missed 1 of 3 necessary brakings, and had no phantom brakings" in decision_summary(metrics)
    assert "In 3 cases in which it had to brake, it would have begun 0.4 s late" in decision_summary(metrics)
    metrics["decisions"] |= {"lateness_s": None, "onsets": 0}
    assert "late" not in decision_summary(metrics)
    assert not decision_summary({"run": {}})
