import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from harness.analysis.why import DEATH, SWITCH, TrackFailure
from harness.commands.app import run_command_line
from harness.report.comparison_page import FARTHER, SWITCHED, UNFOLLOWED, differences, largest_difference
from harness.report.replay_data import SecondRun, replay_data
from harness.running.finished import read_recorded_run
from harness.storage import run_folder as runfolder
from tests.harness import recorded_scene
from tests.harness.report.test_replay_data import unpacked


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return tuple(map(read_recorded_run, recorded_scene.write_lost_and_kept(tmp_path_factory.mktemp("runs"))))


def steps_of(marks, kind, side):
    chosen = marks[(marks["kind"] == kind) & (marks["side"] == side)]
    assert set(chosen["vehicle_id"]) <= {"far"}
    return chosen["step"].tolist()


def test_whom_one_alone_follows_and_who_is_farther_off_by_more_than_a_metre_is_marked_with_the_other(runs):
    marks = differences(*runs, ((), ()))
    assert steps_of(marks, UNFOLLOWED, 0) == list(range(recorded_scene.GIVEN_UP, recorded_scene.NEW_TRACK))
    # Unseen it is 3 m off against 1 m; in sight 0.1 m against 1 m, which is no difference.
    assert steps_of(marks, FARTHER, 0) == list(range(recorded_scene.LAST_SEEN + 1, recorded_scene.GIVEN_UP))
    assert steps_of(marks, UNFOLLOWED, 1) == steps_of(marks, FARTHER, 1) == []


def test_a_track_that_is_farther_off_than_the_hidden_cost_counts_follows_nobody(runs):
    lost, kept = runs
    off = replace(lost, errors=lost.errors.assign(lon_error_m=10.0 * lost.errors["lon_error_m"]))  # unseen, 30 m
    assert steps_of(differences(off, kept, ((), ())), UNFOLLOWED, 0) == list(
        range(recorded_scene.LAST_SEEN + 1, recorded_scene.NEW_TRACK)
    )


def test_an_identity_switch_of_one_is_marked_for_a_second_and_one_of_both_is_not(runs):
    switch = TrackFailure(SWITCH, DEATH, "far", 4.3, 2, 3)
    twice = (switch, replace(switch, time_s=4.5))
    assert steps_of(differences(*runs, (twice, ())), SWITCHED, 0) == list(range(43, 56)), "each step once"
    near = TrackFailure(SWITCH, DEATH, "far", 4.8, 5, 6)
    marks = differences(*runs, ((switch,), (near,)))
    assert steps_of(marks, SWITCHED, 0) == steps_of(marks, SWITCHED, 1) == []


def test_which_run_comes_first_changes_the_side_and_nothing_else(runs):
    a, b = runs
    there, back = differences(a, b, ((), ())), differences(b, a, ((), ()))
    turned = back.assign(side=1 - back["side"]).sort_values(list(there), ignore_index=True)
    pd.testing.assert_frame_equal(turned, there.sort_values(list(there), ignore_index=True))


def test_the_replay_opens_when_the_trackers_differ_for_most_vehicles():
    truth = pd.DataFrame({"step": [30, 40, 40], "time_s": [3.0, 4.0, 4.0]})
    marks = pd.DataFrame({"step": [30, 40, 40], "vehicle_id": ["one", "two", "three"]})
    assert largest_difference(marks, truth) == (4.0, "two")
    assert largest_difference(marks[:0], truth) is None
    at_the_end = truth.assign(time_s=[3.0, 9.0, 9.0])
    assert largest_difference(marks, at_the_end) == (3.0, "one"), "what is left to watch is too short"


def test_both_trackers_share_what_happened_on_the_road(runs):
    a, b = runs
    marks = differences(a, b, ((), ()))
    data = json.loads(json.dumps(replay_data(a, SecondRun(b, marks, (2.0, "far")))))
    alone = replay_data(b)
    for name in ("error", "track", "outcome"):
        assert data["other"]["truth"][name] == alone["truth"][name]
    assert data["other"]["tracks"] == alone["tracks"]
    assert data["opens_at"] == [2.0, "far"]
    counts = np.diff(unpacked(data["marks"]["first"]).astype(int))
    assert counts.tolist() == [int((marks["step"] == step).sum()) for step in range(recorded_scene.STEPS)]
    assert set(unpacked(data["marks"]["vehicle"]).tolist()) == {data["vehicles"]["names"].index("far")}


def test_the_page_of_two_runs_on_the_same_detections_holds_both_in_one_replay(tmp_path, capsys):
    folders = [recorded_scene.write_recorded_scene(tmp_path / name) for name in ("a", "b")]
    page = tmp_path / "page.html"
    assert run_command_line(["compare", *map(str, folders), "--html", str(page), "--allow-undecided", "--quiet"]) == 0
    text = page.read_text(encoding="utf-8")
    assert text.count('class="road"') == 2
    assert text.count('id="scrub"') == 1
    addresses = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert any(address.startswith("#t=") for address in addresses)
    assert [address for address in addresses if not address.startswith(("#", "data:"))] == []


def test_runs_on_different_detections_are_compared_without_a_replay(tmp_path, capsys):
    folders = [recorded_scene.write_recorded_scene(tmp_path / name) for name in ("a", "b")]
    detections = pd.read_parquet(folders[1] / runfolder.DETECTIONS)
    recorded_scene.rewrite(folders[1], runfolder.DETECTIONS, detections.assign(lon_m=detections["lon_m"] + 0.01))
    page = tmp_path / "page.html"
    options = ["--html", str(page), "--allow-undecided", "--allow-different", "--quiet"]
    assert run_command_line(["compare", *map(str, folders), *options]) == 0
    assert "<canvas" not in page.read_text(encoding="utf-8")
