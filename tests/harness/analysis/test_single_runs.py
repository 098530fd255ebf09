"""Two single runs, vehicle by vehicle: six cars under two trackers, with what is told of both."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.analysis.compare import compare
from harness.analysis.rules import Rules, compared_quantities
from harness.analysis.single import BY_VEHICLE, compare_runs, evidence_of, read_seen
from harness.analysis.sources import Source
from harness.analysis.vehicles import closeness, hota_by_vehicle, ratio_by_vehicle
from harness.analysis.why import failures
from harness.common.errors import InputError
from harness.scoring.metrics.registry import score_metrics
from harness.storage.grid_folder import flattened
from tests.harness.analysis.test_vehicles import CARS, six_cars
from tests.harness.recorded_scene import write_recorded_scene


@pytest.fixture(scope="module")
def both() -> dict:
    return {Path("A"): six_cars(3, 120.0), Path("B"): six_cars(4, 120.0)}


@pytest.fixture
def sides(both, monkeypatch) -> list[Source]:
    """Return both runs, whose evidence is at hand and whose traffic is known to be the same."""
    monkeypatch.setattr("harness.analysis.single.evidence_of", lambda folder, seen: both[folder])
    monkeypatch.setattr("harness.analysis.single.read_seen", lambda a, b: ({}, {}))
    made = []
    for folder, evidence in both.items():
        row = {"label": f"tracker {folder}", **flattened(score_metrics(evidence))}
        made.append(Source(f"run {folder}", folder, pd.DataFrame([row]), 0, True))
    return made


def test_every_compared_metric_of_two_runs_is_measured_in_its_order(sides, both):
    told, _ = compare_runs(*sides, both.values(), Rules())
    assert [each.quantity.key for each in told] == [each.key for each in compared_quantities()]


def test_the_value_of_each_side_is_its_metric_and_errors_are_on_the_steps_of_both(sides, both):
    told = {each.quantity.key: each for each in compare_runs(*sides, both.values(), Rules())[0]}
    first, second = both.values()
    for key in ("mot.hota", "mot.idf1", "hidden.hidden_cost_m", "occlusion.same_id_percent", "mot_all.hota"):
        assert [told[key].a, told[key].b] == pytest.approx([side.rows[key].iloc[0] for side in sides])
    keys = ["step", "vehicle_id"]
    tables = [side.error_table[side.error_table["state"].eq("visible")] for side in (first, second)]
    joined = tables[0].merge(tables[1], on=keys)
    joined = joined[joined["outcome_x"].eq("tracked") & joined["outcome_y"].eq("tracked")]
    assert told["mae.visible.lon_m"].a == pytest.approx(joined["lon_error_m_x"].abs().mean())
    assert told["mae.visible.lon_m"].b == pytest.approx(joined["lon_error_m_y"].abs().mean())
    near = closeness(first.rows.truth, CARS)
    parts = [hota_by_vehicle(side, CARS) for side in (first, second)]
    influence = parts[1].influence - parts[0].influence
    units = CARS**2 / near.sum()
    strays = sum(float(part.others @ part.others) for part in parts)
    scatter = max(influence @ near @ influence, influence @ influence)
    assert told["mot.hota"].effect.se == pytest.approx(np.sqrt(scatter * (units / (units - 1)) ** 2 + strays))


def test_a_score_of_a_whole_run_has_a_difference_and_no_scatter(sides, both):
    sides[1].rows["mot.idf1"] = sides[0].rows["mot.idf1"]
    sides[0].rows["mot_all.hota"] = np.nan
    told = {each.quantity.key: each for each in compare_runs(*sides, both.values(), Rules())[0]}
    same, missing, other = told["mot.idf1"], told["mot_all.hota"], told["hidden_outcomes.tracked_percent"]
    assert (same.effect.difference, same.same, same.pairs, same.effect.units) == (0.0, True, 1, 1.0)
    assert np.isnan(same.effect.se)
    assert (missing.pairs, missing.same, missing.wanting) == (0, False, "")
    assert (other.same, other.pairs) == (False, 1)
    assert other.effect.difference == other.b - other.a != 0.0


def test_a_run_is_no_worse_than_itself_though_false_tracks_scatter(sides, both):
    assert len(hota_by_vehicle(both[Path("A")], CARS).others)
    compared = compare(sides[0], sides[0], Rules())
    assert (compared.outcome, {verdict.verdict for verdict in compared.primary}) == ("no worse", {"no worse"})
    assert "the pairs are vehicles" in compared.paired


@pytest.mark.parametrize("more", [0.0, 0.5])
def test_a_hidden_cost_that_falls_while_false_hidden_tracks_increase_is_noted(more, sides, monkeypatch):
    costs = (ratio_by_vehicle(mean + 0.1 * np.arange(CARS), np.arange(CARS), CARS) for mean in (9.0, 2.0))
    monkeypatch.setitem(BY_VEHICLE, "hidden.hidden_cost_m", lambda *_: next(costs))
    sides[1].rows["hidden.false_hidden_tracks_per_scan"] += more
    compared = compare(*sides, Rules(primary=("hidden.hidden_cost_m",)))
    assert [verdict.verdict for verdict in compared.primary] == ["better"]
    assert ("guesses lower both" in " ".join(compared.notes)) == (more > 0.0)


def test_the_failures_of_both_runs_are_told_with_where_they_can_be_watched(sides, both):
    why = compare_runs(*sides, both.values(), Rules())[1]
    first, second = both.values()
    assert (list(why.a), list(why.b)) == (failures(first), failures(second))
    assert (why.folder_a, why.folder_b) == ("A", "B")


def test_runs_on_other_traffic_are_refused_and_a_spoilt_table_is_told(tmp_path):
    folders = [write_recorded_scene(tmp_path / name) for name in "ab"]
    rows = pd.DataFrame([{"label": "x"}])
    a, b = (Source(f"run {folder.name}", folder, rows, 0, True) for folder in folders)
    evidence = evidence_of(folders[0], read_seen(a, b)[0])
    assert sorted(set(evidence.rows.tracks.track_id.tolist())) == [1, 2, 3]
    assert len(evidence.rows.truth) == 3 * 60
    truth = pd.read_parquet(folders[1] / "truth.parquet")
    truth.assign(lon_m=truth["lon_m"] + 1.0).to_parquet(folders[1] / "truth.parquet")
    with pytest.raises(InputError, match=rf"different traffic.*`replay` {folders[0]}"):
        read_seen(a, b)
    for name, column in (("truth", "state"), ("detections", "truth_id"), ("tracks", "std_lon_m")):
        folder = write_recorded_scene(tmp_path / name)
        table = pd.read_parquet(folder / f"{name}.parquet")
        table.drop(columns=column).to_parquet(folder / f"{name}.parquet")
        with pytest.raises(InputError, match=rf"`compare`.*{name}.parquet.*{column}"):
            evidence_of(folder, read_seen(*[Source("run", folder, rows, 0, True)] * 2)[0])
