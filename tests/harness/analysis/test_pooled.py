"""Scores over several recorded files: pooled by their samples, with intervals over files, beside coasting."""

import json

import numpy as np
import pandas as pd
import pytest

from harness.analysis.coasting_ratio import on_purpose
from harness.analysis.pooled import pool_files
from harness.analysis.pooled_tables import pooled_markdown
from harness.grid.grid import GridRequest, plan_grid
from harness.grid.stress import FIGURES, SUMMARY, TABLE, Telling, run_stress
from harness.running.open import open_snapshots
from harness.scoring.metrics.pseudo_occlusion import HiddenWindows, scores_of_pseudo_occlusions
from harness.storage.grid_folder import RUNS, flattened
from mmpf.numerics.arrays import BoolArray
from tests.harness.grid.executors import ECHO, InProcess
from tests.harness.scoring.scenes import Scene, score_run
from tests.harness.truth.recorded.layouts import write_commonroad, write_ngsim_csv


def row(file: str, variant: str = "mmpf", switches: int = 0, hota=(80.0, 100), hidden=(1.0, 2.0, 10), **other) -> dict:
    own, coasting, n = hidden
    return {
        "replay": file, "variant": variant, "model": None, "seed": 0, "succeeded": True, "error": None,
        "recording.vehicles_read": 30, "recording.vehicles_kept": 28, "recording.egos": 3,
        "mot.hota": hota[0], "mot.idf1": 90.0, "mot.truth_n": hota[1], "mot.id_switches": switches,
        "mae.visible.lon_m": 0.1, "mae.visible.n": 10, "mae.hidden.lon_m": own, "mae.hidden.n": n,
        "hidden_outcomes.tracked_percent": 50.0, "hidden_outcomes.n": 2 * n, "mot.tracks_n": hota[1],
        "occlusion.same_id": 1, "occlusion.events": 2,
        "against_coasting.by_seconds_hidden.0.from_s": 2.0, "against_coasting.by_seconds_hidden.0.to_s": 3.0,
        **{
            f"against_coasting.{key}.{name}": value
            for key in ("hidden", "by_seconds_hidden.0")
            for name, value in (("lon_m", own), ("coasting_lon_m", coasting), ("n", n))
        },
        **other,
    }  # fmt: skip


def mean_of(pooled, quantity: str):
    return next(mean for mean in pooled.means if mean.quantity == quantity)


def test_scores_are_weighted_by_the_samples_of_each_file():
    rows = pd.DataFrame([row("a", hota=(80.0, 100)), row("b", hota=(90.0, 300))])
    pooled = pool_files(rows.assign(**{"timing.steps": [10, 40], "hidden.false_hidden_tracks_per_scan": [1.0, 2.0]}))
    hota, false = mean_of(pooled, "hota"), mean_of(pooled, "false_hidden_tracks_per_scan")
    assert (hota.mean, false.mean) == pytest.approx((87.5, 1.8))
    # Of two files the t distribution has one degree of freedom: 12.7 standard errors to either side.
    assert hota.ci95[0] < 80.0
    assert hota.ci95[1] > 90.0


@pytest.mark.parametrize("every", [1, 2, 5], ids=["10 Hz", "5 Hz", "2 Hz"])
def test_identity_switches_a_vehicle_minute_do_not_depend_on_the_rate_of_scans(every):
    scene = Scene(600).vehicle("a", lon=20.0, detected=True)
    for track in range(4):
        scene.track(track, lon=20.0, at=range(150 * track, 150 * track + 150))
    first = [table[table["step"] % every == 0] for table in scene.tables()]
    scores = flattened(score_run(*(table.assign(step=table["step"] // every) for table in first)).metrics)
    pooled = pool_files(pd.DataFrame([row(name) | scores for name in "ab"]))
    assert pooled.id_switches == {"mmpf": 6}
    switches = mean_of(pooled, "id_switches_per_vehicle_minute")
    # It is in sight for the minute but for the two scans before its third detection.
    assert switches.mean == pytest.approx(3.0 / (1.0 - 2.0 * 0.1 * every / 60.0))
    assert scores["mot.id_switches_per_vehicle_minute"] == pytest.approx(switches.mean)
    assert scores["mot_all.id_switches_per_vehicle_minute"] == pytest.approx(3.0)


def test_the_ratio_to_coasting_is_that_of_all_errors_together():
    table = pd.DataFrame([row("a", hidden=(1.0, 2.0, 10)), row("b", hidden=(4.0, 2.0, 30))])
    overall = pool_files(table).hidden[-1]
    assert overall.to_s is None
    assert overall.lon_m == pytest.approx((10 + 120) / 40)
    assert overall.ratio == pytest.approx((10 + 120) / (20 + 60))
    assert 0.0 <= overall.ratio_ci95[0] < overall.ratio < overall.ratio_ci95[1]


# File, seed, length s, situation, error m (nan: not followed), constant velocity's, same identity, in ellipse.
WINDOWS = [
    ("a", 0, 3, 0, 1.0, 4.0, 1, 1), ("a", 0, 3, 0, 9.0, 2.0, 1, 0), ("a", 0, 1, 1, 2.0, 1.0, 0, 1),
    ("a", 1, 3, 1, np.nan, 7.0, 0, 0), ("a", 1, 3, 0, 20.0, 5.0, 1, 0), ("b", 0, 3, 0, 2.0, 8.0, 1, 1),
    ("c", 0, 3, 1, np.nan, 1.0, 0, 0), ("c", 0, 3, 0, 3.0, 9.0, 0, 1),
]  # fmt: skip


def runs_hiding_on_purpose(windows=WINDOWS) -> pd.DataFrame:
    rows = []
    for file, seed in dict.fromkeys(each[:2] for each in windows):
        length, situation, error, constant, same, inside = np.array([e[2:] for e in windows if e[:2] == (file, seed)]).T
        in_range = error != 20.0  # when identity is judged
        inputs = (length, np.isfinite(error), error, constant, inside > 0, same > 0, in_range, situation)
        scores = flattened(scores_of_pseudo_occlusions([HiddenWindows(*inputs)], None), "pseudo_occlusion.")
        rows.append(row(file, **scores) | {"seed": seed})
    return pd.DataFrame(rows)


@pytest.mark.parametrize(("kind", "place", "value"), [("3s", 2, 3), ("following", 3, 0)])
def test_scores_of_vehicles_hidden_on_purpose_are_over_all_windows_and_their_ratio_is_that_of_sums(kind, place, value):
    chosen = [each for each in WINDOWS if each[place] == value]
    followed = [each for each in chosen if np.isfinite(each[4])]
    error, constant = sum(each[4] for each in followed), sum(each[5] for each in followed)
    cost = sum(min(each[4], 10.0) if each in followed else 10.0 for each in chosen)
    pooled = pool_files(runs_hiding_on_purpose())
    told = [mean_of(pooled, each.key) for each in on_purpose([kind])]
    same, inside = [each[6] for each in chosen if each[4] != 20.0], sum(each[7] for each in followed)
    expected = [100 * len(followed) / len(chosen), error / constant, cost / len(chosen)]
    expected += [100 * sum(same) / len(same), 100 * inside / len(followed)]
    assert [mean.mean for mean in told] == pytest.approx(expected)
    cells = f"| {kind} | mmpf | {len(chosen)} | {expected[0]:.1f} ["
    assert cells in pooled_markdown(pooled, [])
    # The runs of a file are one unit, and Student's interval of a ratio has one degree of freedom less than files.
    files = [[each for each in followed if each[0] == file] for file in "abc"]
    residuals = [sum(each[4] - error / constant * each[5] for each in file) / constant for file in files]
    half = 4.302653 * np.sqrt(3 / 2 * sum(residual**2 for residual in residuals))
    assert told[1].ci95 == pytest.approx((max(0.0, error / constant - half), error / constant + half))


def test_the_error_of_hidden_vehicles_has_the_followed_share_beside_it():
    by_time = {f"mae.by_seconds_hidden.0.{name}": value for name, value in (("tracked_percent", 25.0), ("hidden_n", 4))}
    first, overall = pool_files(pd.DataFrame([row("a", **by_time), row("b", **by_time)])).hidden
    assert (first.followed_percent, overall.followed_percent) == (25.0, 50.0)
    assert "25 % followed" in pooled_markdown(pool_files(pd.DataFrame([row("a", **by_time)])), [])


def test_runs_that_failed_are_told():
    assert "- it broke" in pooled_markdown(pool_files(pd.DataFrame([row("a")])), ["it broke"])


def test_every_file_and_vehicle_is_counted():
    text = pooled_markdown(pool_files(pd.DataFrame([row("a.xml"), row("b.xml")])), [])
    assert "| a.xml | 30 | 28 | 2 | 3 | 1 |" in text
    assert "| all | 60 | 56 | 4 | 6 | 2 |" in text


@pytest.fixture
def files(tmp_path) -> tuple[str, str]:
    return str(write_ngsim_csv(tmp_path / "scene.csv")), str(write_commonroad(tmp_path / "scene.xml"))


def test_a_grid_over_recordings_has_a_cell_a_file_with_every_vehicle_in_turn(files):
    grid = plan_grid(GridRequest(net=None, replay=files, trackers=f"{ECHO},mmpf", seeds="1"))
    assert [cell.runs[0].identity()["replay"] for cell in grid.cells] == ["scene.csv", "scene.xml"]
    assert {run.config.traffic.recording.ego for run in grid.runs} == {"each"}
    assert [cell.config.traffic.net for cell in grid.cells] == ["us101", "recording"]


@pytest.mark.slow
def test_recordings_leave_one_table_over_all_files_with_all_vehicles_counted(files, tmp_path, no_pictures):
    request = GridRequest(net=None, replay=files, ego="each:2", trackers=f"{ECHO},oracle-kalman", seeds="1")
    told: list[str] = []
    finished = run_stress(
        request, tmp_path / "out", InProcess(open_snapshots=open_snapshots), user=Telling(tell=told.append)
    )
    assert finished.failures == []
    assert [text.split(" (")[0] for text in told] == ["scene.csv", "scene.xml"]
    summary = json.loads((tmp_path / "out" / SUMMARY).read_text())
    assert [(each["file"], each["egos"], each["runs"]) for each in summary["files"]] == [
        ("scene.csv", 2, 2),
        ("scene.xml", 2, 2),
    ]
    runs = pd.read_parquet(tmp_path / "out" / RUNS)
    assert runs["replay"].tolist() == ["scene.csv"] * 2 + ["scene.xml"] * 2
    oracle = runs[runs["tracker"] == "oracle-kalman"]
    followed: BoolArray = oracle["against_coasting.hidden.n"].to_numpy() > 0
    np.testing.assert_array_equal(
        oracle["against_coasting.hidden.lon_m"].to_numpy()[followed],
        oracle["against_coasting.hidden.coasting_lon_m"].to_numpy()[followed],
    )
    assert "| scene.csv | 4 | 4 | 0 | 2 | 2 |" in (tmp_path / "out" / TABLE).read_text()
    assert (tmp_path / "out" / FIGURES / "hidden.png").exists()


def test_a_broken_recording_is_told_before_any_run(files, tmp_path, refused):
    broken = tmp_path / "broken.xml"
    broken.write_text('<commonRoad commonRoadVersion="2018b"><lanelet id="1">')
    words = ["stress", "--replay", files[0], "--replay", broken, "--trackers", ECHO, "--out", "out", "--quiet"]
    assert "broken.xml" in refused(*words)
    assert not (tmp_path / "out").exists()
