import numpy as np
import pandas as pd
import pytest

from harness.report.gallery import draw_gallery, strip_figure, worst_events
from harness.running.finished import read_recorded_run
from tests.harness.recorded_scene import LAST_SEEN, SEEN_AGAIN, write_recorded_scene


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
    return read_recorded_run(write_recorded_scene(tmp_path / "run"))


def test_lost_and_stolen_tracks_come_first_then_the_largest_error_then_the_longest():
    table = pd.DataFrame(
        [event("kept", "same_id"), event("astray", "survived"), event("stolen", "hijacked"), event("lost", "lost"),
         event("long", "lost", 4.0), event("longer", "lost", 9.0)]
    )  # fmt: skip
    off = errors(kept=20.0, astray=15.0, stolen=3.0, lost=5.0, long=1.0, longer=1.0)
    order = [chosen.vehicle_id for chosen in worst_events(table, off, count=6)]
    assert order == ["lost", "stolen", "longer", "long", "astray", "kept"]
    assert [chosen.vehicle_id for chosen in worst_events(table, off, count=2)] == order[:2]


def test_only_the_error_of_the_events_own_track_between_the_two_sightings_counts():
    off = errors(car=1.0)
    off.loc[off["step"] == 15, ["lon_error_m", "lat_error_m"]] = [3.0, 4.0]
    off.loc[off["step"] == 16, ["track_id", "lon_error_m"]] = [2, 50.0]
    off.loc[off["step"] == 30, "lon_error_m"] = 60.0
    assert worst_events(pd.DataFrame([event("car", "lost")]), off)[0].largest_error_m == pytest.approx(5.0)


def test_an_event_without_any_error_is_told_without_one():
    (chosen,) = worst_events(pd.DataFrame([event("car", "lost")]), errors(other=1.0))
    assert np.isnan(chosen.largest_error_m)
    assert "off" not in chosen.sentence()
    assert "nan" not in chosen.sentence()


def test_the_strip_tells_the_story_of_a_lost_track(run):
    (lost,) = worst_events(run.events, run.errors)
    assert (lost.vehicle_id, lost.outcome, lost.from_step, lost.to_step) == ("far", "lost", LAST_SEEN, SEEN_AGAIN)
    panels = strip_figure(run, lost).axes
    assert [panel.get_title() for panel in panels] == [
        "last seen, 2.0 s", "hidden for 0.7 s", "hidden for 1.3 s", "seen again, 4.0 s", "0.5 s later",
    ]  # fmt: skip
    assert [panel.get_xlabel() for panel in panels] == [
        "track 2: 0.1 m off", "track 2: 3.0 m off", "track 2 is gone", "track 2 is gone", "track 2 is gone",
    ]  # fmt: skip


def test_strips_of_an_earlier_report_are_removed(run):
    figures = run.folder / "figures"
    (figures / "gallery-5.png").write_bytes(b"old")
    paths = draw_gallery(run, worst_events(run.events, run.errors), figures)
    assert [path.name for path in paths] == ["gallery-1.png"]
    assert sorted(path.name for path in figures.iterdir()) == ["gallery-1.png"]
