"""The gallery of decisions: the worst brakings in words and pictures."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from harness.common.errors import InputError
from harness.common.numbers import as_json
from harness.decisions.decide import driver_of
from harness.report.decision_gallery import decision_figure, worst_brakings
from harness.report.page import write_run_page
from harness.report.summary_text import decision_summary
from harness.running.finished import read_recorded_run
from harness.scoring.driving.asked import DriverSetup
from harness.storage import run_folder as runfolder
from harness.storage.tables import write_table
from tests.harness.recorded_scene import rewrite, write_recorded_scene
from tests.harness.scoring.scenes import score_run

BRAKING = {
    "kind": "missed", "episode": 0, "from_step": 30, "to_step": 39, "step": 35, "duration_s": 1.0, "truth_mps2": -4.0,
    "tracks_mps2": 0.5, "vehicle_id": "far", "visibility": "hidden", "unseen_s": 1.5, "track_id": -1, "fate": "lost",
}  # fmt: skip


@pytest.fixture
def folder(tmp_path):
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


def test_the_worst_differ_most_for_longest():
    table = pd.DataFrame([
        BRAKING | {"vehicle_id": "short", "duration_s": 0.5, "truth_mps2": -9.0},
        BRAKING | {"vehicle_id": "long", "duration_s": 4.0, "truth_mps2": -3.0},
        BRAKING | {"vehicle_id": "mild", "duration_s": 0.5, "truth_mps2": -2.0},
    ])  # fmt: skip
    assert [each.vehicle_id for each in worst_brakings(table)] == ["long", "short", "mild"]
    assert [each.vehicle_id for each in worst_brakings(table, count=1)] == ["long"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, "Missed braking for far, unseen for 1.5 s: -4.0 m/s² by the truth and 0.5 m/s² by the tracks, for 1.0 s;"
             " its track was given up."),
        ({"fate": "none", "unseen_s": np.nan}, "never detected"),
        ({"fate": "displaced", "track_id": 4, "unseen_s": 0.0, "visibility": "partial"}, "far, partly hidden: "),
        ({"fate": "displaced", "track_id": 4}, "track 4 follows it, but stands or moves otherwise than it does."),
        ({"fate": "hijacked", "track_id": 4}, "its track 4 sits on another vehicle."),
        ({"kind": "phantom", "fate": "ghost", "track_id": 4, "vehicle_id": ""}, "track 4 follows no vehicle."),
        ({"kind": "phantom", "fate": "hijacked", "track_id": 4}, "track 4 went over from another vehicle to far"),
    ],
)  # fmt: skip
def test_a_sentence_tells_who_was_to_blame_and_why(change, words):
    (braking,) = worst_brakings(pd.DataFrame([BRAKING | change]))
    assert words in braking.sentence()
    assert not re.search(r"\{|nan|-1\b", braking.sentence())


def test_a_strip_shows_three_moments_and_what_is_demanded(folder):
    run = read_recorded_run(folder)
    for braking in worst_brakings(run.brakings):
        *panels, curves = decision_figure(run, braking).axes
        assert [panel.get_title() for panel in panels] == ["begins, 3.0 s", "differ most, 3.5 s", "ends, 3.9 s"]
        truth, tracks = (line for line in curves.get_lines() if len(line.get_xdata()) > 2)
        assert np.asarray(truth.get_ydata()).min() < np.asarray(tracks.get_ydata()).min()
        assert curves.get_xlim() == pytest.approx((0.0, 5.9))


def test_the_page_leads_from_a_decision_to_the_replay(folder):
    page = write_run_page(folder).read_text(encoding="utf-8")
    section = page[page.index('<section id="decisions"') :]
    buttons = re.findall(r'data-vehicle="(\w+)" data-time="([\d.]+)" data-until="([\d.]+)"', section)
    assert buttons == [("far", "2.0", "4.4"), ("ego", "2.0", "4.4")]
    assert "says how hard it would brake" in section


def test_a_run_that_asked_no_driver_has_a_page_without_decisions(tmp_path):
    page = write_run_page(write_recorded_scene(tmp_path / "run")).read_text(encoding="utf-8")
    assert 'href="#decisions"' not in page


@pytest.mark.parametrize("change", [{"fate": "eaten"}, {"kind": "other"}, {"from_step": "x"}])
def test_a_broken_table_of_brakings_is_refused_in_one_line(folder, change):
    rewrite(folder, runfolder.BRAKINGS, pd.DataFrame([BRAKING | change]))
    with pytest.raises(InputError, match=r"brakings\.parquet"):
        write_run_page(folder)


def test_the_summary_is_told_without_what_was_not_measured(folder):
    metrics = json.loads((folder / runfolder.METRICS).read_text())
    metrics["decisions"] |= {"missed": 1, "phantom": 0, "lateness_s": 0.4, "onsets": 3}
    assert "cause 1 braking to be missed and no false brakings" in decision_summary(metrics)
    assert "In 3 cases in which it had to brake it would have begun 0.4 s late" in decision_summary(metrics)
    metrics["decisions"] |= {"lateness_s": None, "onsets": 0}
    assert "late" not in decision_summary(metrics)
    assert not decision_summary({"run": {}})
