"""Vehicles in plain view without a track stand first in the failure gallery, in plain words."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from harness.report.gallery import strip_figure, worst_failures
from harness.report.html_tables import mot_table
from harness.report.page import write_run_page
from harness.report.summary import print_summary
from harness.report.summary_text import summary_sentences
from harness.report.withheld_gallery import Withheld, withheld_vehicles, withheld_words
from harness.running.finished import read_recorded_run
from harness.storage import run_folder as runfolder
from tests.harness.recorded_scene import write_recorded_scene

ENTRY = {
    "id": "near", "kind": "never reported", "episode": 0, "from_s": 1.0, "to_s": 5.0, "closest_m": 14.6,
    "without_track_s": 4.1, "detected_percent": 36.4,
}  # fmt: skip


@pytest.fixture
def run(tmp_path):
    folder = write_recorded_scene(tmp_path / "run")
    metrics = json.loads((folder / runfolder.METRICS).read_text())
    metrics["in_plain_view"] |= {"never_reported": 1, "dropped": 0, "vehicles": [ENTRY]}
    (folder / runfolder.METRICS).write_text(json.dumps(metrics))
    return read_recorded_run(folder)


def with_vehicles(run, *entries):
    return replace(run, metrics=run.metrics | {"in_plain_view": run.metrics["in_plain_view"] | {"vehicles": entries}})


def test_a_withheld_vehicle_stands_before_every_occlusion(run):
    assert [failure.vehicle_id for failure in worst_failures(run)] == ["near", "far"]


@pytest.mark.parametrize(
    ("length_m", "dropped", "begins", "ends"),
    [
        (4.5, False, "A car in", "It is v1, and never had a track."),
        (2.2, True, "A two-wheeler in", "It is v1, and had a track before that."),
        (12.0, False, "A lorry in", "It is v1, and never had a track."),
        (np.nan, False, "A car in", "It is v1, and never had a track."),
    ],
)
def test_its_caption_is_a_plain_sentence(length_m, dropped, begins, ends):
    told = Withheld("v1", dropped, 1.0, 7.1, 40.2, 6.2, 36.1, length_m).sentence()
    assert told.startswith(begins)
    assert told.endswith(ends)
    assert "plain view at 40 m had no track for 6.2 s; it was detected in 36 % of scans." in told


def test_its_strip_shows_the_time_without_a_track(run):
    (found,) = withheld_vehicles(run)
    panels = strip_figure(run, found).axes
    assert [panel.get_title() for panel in panels] == [
        "in plain view, 1.0 s", "1.0 s later", "2.0 s later", "3.0 s later", "4.0 s later",
    ]  # fmt: skip
    assert {panel.get_xlabel() for panel in panels} == {"no track held it"}
    assert found.replayed_s(run) == (1.0, 5.5)


def test_a_run_without_the_score_and_a_vehicle_that_is_not_shown_have_no_strip(run):
    old = replace(run, metrics={key: value for key, value in run.metrics.items() if key != "in_plain_view"})
    assert withheld_vehicles(old) == []
    assert withheld_words(old.metrics) == ""
    assert withheld_vehicles(with_vehicles(run, ENTRY | {"id": "gone"}, ENTRY | {"to_s": 99.0})) == []


def test_at_most_four_are_shown_the_worst_first(run):
    entries = [ENTRY | {"without_track_s": 9.0 - k} for k in range(6)]
    assert [each.without_track_s for each in withheld_vehicles(with_vehicles(run, *entries))] == [9.0, 8.0, 7.0, 6.0]


def test_the_page_says_how_many_there_are_and_shows_the_first(run):
    text = write_run_page(run.folder).read_text(encoding="utf-8")
    assert "come first (1 never got a track)." in text
    first = text.index("A car in plain view at 15 m had no track for 4.1 s; it was detected in 36 % of scans.")
    assert first < text.index("far, hidden for")
    assert (run.folder / "figures" / "gallery-2.png").is_file()


def test_the_screen_the_page_and_the_summary_tell_recall_and_an_old_run_has_none(run, capsys):
    scores = run.metrics["in_plain_view"] | {"recall": 97.25, "worst_tenth": 12.0, "never_reported": 1, "dropped": 2}
    known = run.metrics | {"in_plain_view": scores}
    old = {key: value for key, value in run.metrics.items() if key != "in_plain_view"}
    sentence = (
        "had a track 97.2 % of the time (12 % for the worst tenth of them). 1 vehicle never got a track, and 2 vehicles"
    )
    assert sentence in " ".join(summary_sentences(known))
    assert "97.2" in str(mot_table(known))
    print_summary(known, run.folder)
    screen = " ".join(capsys.readouterr().err.split())
    assert "In plain view with a track: 97.2 %, worst tenth of vehicles 12.0 %; never reported 1, dropped 2" in screen
    assert "In plain view" not in " ".join(summary_sentences(old))
    assert "worst tenth %" in str(mot_table(old))
    print_summary(old, run.folder)
    assert "In plain view" not in capsys.readouterr().err
