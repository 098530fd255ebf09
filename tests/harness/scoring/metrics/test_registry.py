"""Metrics are registered once, under a name of their own, and none moves another's numbers."""

import copy
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.analysis.curves import CURVES, TABLED
from harness.analysis.pooled import POOLED
from harness.analysis.rules import COMPARED
from harness.decisions.decide import driver_of
from harness.lab.ablation import COLUMNS
from harness.report.summary import REPORTED
from harness.scoring.driving.asked import DriverSetup
from harness.scoring.metrics import registry
from harness.scoring.metrics.quantity import STEPS, Quantity
from harness.scoring.metrics.registry import completed, quantities, register, view
from harness.storage.grid_folder import flattened
from mmpf.map.corridor_road import highway
from tests.harness.scoring.scenes import score_run, traffic


@pytest.fixture(autouse=True)
def own_registry(monkeypatch) -> None:
    """Let what a test registers end with it."""
    monkeypatch.setattr(registry, "METRICS", copy.deepcopy(registry.METRICS))


@pytest.fixture(scope="module")
def tables():
    return traffic(steps=60, vehicles=20)


def test_a_registered_function_is_scored_and_its_nan_is_none(tables):
    @register("toy")
    def toy(evidence) -> dict[str, object]:
        return {"steps": len(evidence.rows.time_s), "nothing": np.float64("nan")}

    assert score_run(*tables).metrics["toy"] == {"steps": 60, "nothing": None}


def test_a_name_that_is_taken_and_a_quantity_of_another_metric_are_refused():
    with pytest.raises(ValueError, match="'mae' is registered already"):
        register("mae")(dict)
    with pytest.raises(ValueError, match=r"'mea.n' must begin with 'toy.'"):
        register("toy", Quantity("mea.n", "samples"))(dict)
    assert "toy" not in registry.METRICS.in_order()


EXAMPLE = Path(__file__).parents[4] / "docs" / "how-to" / "metric.md"


def unseen():
    columns = ("step", "time_s", "from_lon_m", "from_lat_m", "to_lon_m", "to_lat_m", "expected")
    return pd.DataFrame([(0, 0.0, 0.0, 0.0, 25.0, 0.0, 0.1)], columns=columns)


# On every road, and optional since runs that are older have none of it.
YOUNGER = ("in_plain_view.", "existence_calibration.", "calibration.", "motion.")


def test_what_a_metric_tells_of_its_numbers_is_among_its_numbers(tables):
    truth, detections, tracks = tables
    told = {key: each.is_of_some_runs for each in quantities() for key in {each.key, each.weight} - {"", STEPS}}
    driven = DriverSetup(driver_of("hdm"), highway())
    every_road = truth.assign(
        direction_rad=1.0, wall_fraction=0.0, on_roundabout=False, parked=False, pseudo_hidden_s=0.0
    )
    every = score_run(every_road, detections, tracks, driven=driven, unseen=unseen()).metrics
    assert told.keys() <= flattened(every).keys()
    on_road = flattened(score_run(*tables).metrics).keys()
    assert {key for key, optional in told.items() if not optional} <= on_road
    of_some_roads = {key for key, optional in told.items() if optional and not key.startswith(YOUNGER)}
    assert not of_some_roads & on_road


def test_what_was_not_scored_is_null_under_the_same_keys(tables):
    def leaves(table, prefix=""):
        for key, value in table.items():
            if isinstance(value, dict):
                yield from leaves(value, f"{prefix}{key}.")
            elif key not in ("by_seconds_hidden", "vehicles", "deciles"):
                yield f"{prefix}{key}", value

    scores = score_run(*tables).metrics
    unscored = dict(leaves(completed({})))
    assert unscored.keys() == dict(leaves(scores)).keys()
    assert set(unscored.values()) == {None}
    assert completed({"gospa": scores["gospa"]})["gospa"] == scores["gospa"]
    assert completed(scores) == scores


def test_the_documentations_example_is_a_metric(tables):
    (example,) = re.findall(r"```python\n(.*?)```", EXAMPLE.read_text(encoding="utf-8"), re.DOTALL)
    exec(example, {})
    scored = score_run(*tables)
    rows = scored.errors.query("state == 'visible' and outcome == 'tracked'")
    assert (rows["lon_error_m"].abs() < scored.metrics["worst"]["lon_m"]).mean() == pytest.approx(0.95, abs=0.01)


def test_a_view_has_what_it_lists_in_its_order_and_then_what_is_from_outside():
    register("toy", Quantity("toy.a", "a", decimals=2), Quantity("toy.b", "b"))(dict)
    changed = {"mot.idf1": {"label": "identity"}, "toy.b": {"decimals": 0}}
    shown = view(("mot_all.hota", "mot.idf1", "calibration"), changed)
    of_calibration = ["calibration.anees.visible", "calibration.anees.hidden"]
    assert [each.key for each in shown] == ["mot_all.hota", "mot.idf1", *of_calibration, "toy.a", "toy.b"]
    assert [each.label for each in shown[:2]] == ["HOTA last 10 s, %", "identity"]
    assert [each.decimals for each in shown[-2:]] == [2, 0]


@pytest.mark.parametrize("listed", [CURVES, TABLED, POOLED, COMPARED, COLUMNS, REPORTED])
def test_every_view_lists_what_there_is(listed):
    assert all(view((key,)) for key in listed)
    assert len({quantity.key for quantity in view(listed)}) == len(view(listed))
