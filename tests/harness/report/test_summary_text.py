from dataclasses import replace

import numpy as np
import pytest

from harness.report.key_figures import coasting_errors_m, key_figures, key_table
from harness.report.summary import print_summary
from harness.report.summary_text import setting_sentence, summary_sentences
from harness.scoring.metrics.registry import completed
from mmpf.map.corridor_road import highway
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map


@pytest.mark.parametrize(
    ("in_view", "hidden", "words"),
    [
        (95.0, 80.0, "not hidden (about right), 80 % for hidden vehicles (the tracker is too sure"),
        (99.0, 95.0, "99 % for vehicles that are not hidden (the tracker is too unsure)"),
        (95.0, None, "95 % for vehicles that are not hidden (about right)."),
    ],
)
def test_intervals_are_judged_for_visible_and_hidden_vehicles_apart(run, in_view, hidden, words):
    metrics = run.metrics
    for state, share in (("visible", in_view), ("hidden", hidden)):
        metrics["calibration"][state] |= {"n": 1000, "coverage95": {"lon": share}}
    assert words in " ".join(summary_sentences(metrics))
    metrics["calibration"]["visible"]["n"] = 4
    assert "too few samples of vehicles that are not hidden (n = 4)" in " ".join(summary_sentences(metrics))


@pytest.mark.parametrize(("road", "turn_rad"), [(highway(), 0.0), (LaneGraphRoad(without_map()), 0.3)])
def test_constant_velocity_predictions_start_where_a_vehicle_was_last_detected_and_go_as_it_did(run, road, turn_rad):
    run = replace(run, road=road, truth=run.truth.assign(heading_rad=0.3, lat_speed_mps=0.4))
    found, cosine, sine = coasting_errors_m(run), np.cos(turn_rad), np.sin(turn_rad)
    expected = []
    truth = {(row.step, row.vehicle_id): row for row in run.truth.itertuples()}
    for row in run.errors.itertuples():
        if row.state == "hidden":
            begun = truth[row.step - round(row.seconds_hidden / run.step_s), row.vehicle_id]
            now = truth[row.step, row.vehicle_id]
            along, across = begun.speed_mps * row.seconds_hidden, begun.lat_speed_mps * row.seconds_hidden
            ahead = begun.lon_m + along * cosine - across * sine - now.lon_m
            aside = begun.lat_m + along * sine + across * cosine - now.lat_m
            expected.append(min(10.0, (ahead**2 + aside**2) ** 0.5))
    assert expected
    np.testing.assert_allclose(found, expected)


def test_key_figures_bear_the_metrics_numbers_and_intervals(run):
    run.metrics["hidden"] |= {"hidden_cost_m": 3.219, "hidden_cost_m_ci95": [2.402, 4.056]}
    figures = key_figures(run)
    table = str(key_table(figures))
    assert (figures[0].value, figures[0].interval, figures[0].at_top) == ("3.22 m", "2.40 to 4.06 m", True)
    assert "3.22 m<br><span class='interval-cell'>2.40 to 4.06 m" in table
    assert "too few samples, n = 1" in table
    assert "m: constant velocity" in table
    assert "Computing time" in table
    before = {"command": "harness score --truth a --tracks b"} | {key: run.manifest[key] for key in ("status", "seed")}
    for manifest in (run.manifest | {"is_log": True}, before):
        assert "Computing time" not in str(key_table(key_figures(replace(run, manifest=manifest))))


def test_what_was_not_scored_is_left_out(run):
    empty = completed({}) | {key: run.metrics[key] for key in ("run", "timing", "traffic")}
    empty["occlusion"]["events"] = 0
    run.metrics.clear()
    run.metrics.update(empty)
    text = " ".join([*summary_sentences(empty), setting_sentence(empty), str(key_table(key_figures(run)))])
    assert not any(word in text for word in ("None", "nan", ">-<", "0 vehicles per km"))


def test_brakings_stand_at_the_top_with_exact_intervals_and_only_where_a_driver_was_asked(run):
    assert "brakings" not in str(key_table(key_figures(run)))
    driven = {"n": 90, "km": 0.5, "onsets": 10, "missed": 2, "phantom": 0, "missed_per_km": 4.0, "phantom_per_km": 0.0}
    run.metrics["decisions"] = driven
    missed, phantom = (each for each in key_figures(run) if "brakings" in each.name)
    # Clopper and Pearson's interval of 2 of 10 is 2.5 to 55.6 %; of no event, Poisson's mean is up to 3.69.
    assert (missed.at_top, missed.value, missed.interval) == (True, "2 of 10", "3 to 56 %")
    assert (phantom.at_top, phantom.value, phantom.interval) == (True, "0", "0.0 to 7.4 per km")
    driven |= {"onsets": 3, "phantom": 3}
    missed, phantom = (each for each in key_figures(run) if "brakings" in each.name)
    # Garwood's interval of 3 events is 0.619 to 8.767.
    assert (missed.interval, phantom.interval) == ("", "1.2 to 17.5 per km")
    assert "too few samples, n = 3" in missed.detail
    driven |= {"km": 0.02}
    assert "per km" not in str(key_table(key_figures(run))), "a drive of 20 m says nothing of a kilometre"


@pytest.mark.parametrize(
    ("events", "words"),
    [(0, "No vehicle came back into view after an occlusion"), (1, "After 1 occlusion: 1 vehicle had the same track")],
)
def test_occlusions_are_told_in_a_sentence_also_without_any(run, tmp_path, events, words, capsys):
    counts = {"events": events, "survived": events, "same_id": events, "lost": 0, "hijacked": 0}
    print_summary(run.metrics | {"occlusion": counts, "pseudo_occlusion": {"all": {"windows": events}}}, tmp_path)
    told = capsys.readouterr().err
    assert words in told
    assert ("hidden on purpose" in told) == (events == 0)
