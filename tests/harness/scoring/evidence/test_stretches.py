"""A run that is scored stretch by stretch has the scores of the same run in one piece."""

import copy

import pandas as pd
import pytest

from harness.decisions.decide import driver_of
from harness.scoring.driving.asked import DriverSetup
from harness.scoring.metrics import registry
from harness.scoring.metrics.registry import register
from harness.scoring.score import RunScorer
from harness.storage import run_folder as runfolder
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.road import Lane
from tests.harness.scoring.scenes import score_run, traffic

EPISODES, STEPS = 3, 80


@pytest.fixture(scope="module")
def pieces():
    """Return the tables of three episodes with other vehicles' places in each, one after the other."""

    def moved(table: pd.DataFrame, number: int) -> pd.DataFrame:
        step = table["step"] + number * STEPS
        return table.assign(step=step, time_s=0.1 * step, episode=number)

    scenes = [traffic(steps=STEPS, vehicles=12 + number, seed=number) for number in range(EPISODES)]
    return [tuple(moved(table, number) for table in scene) for number, scene in enumerate(scenes)]


def in_one(pieces) -> tuple[pd.DataFrame, ...]:
    return tuple(pd.concat(tables, ignore_index=True) for tables in zip(*pieces, strict=True))


def numbers(table, prefix=""):
    items = table.items() if isinstance(table, dict) else enumerate(table)
    for key, value in items:
        if isinstance(value, dict | list):
            yield from numbers(value, f"{prefix}{key}.")
        elif "ci95" not in f"{prefix}{key}":
            yield f"{prefix}{key}", value


def test_all_scores_are_those_of_the_run_in_one_piece(pieces):
    scorer = RunScorer(seed=4)
    tables = [scorer.add(*piece) for piece in pieces]
    whole = score_run(*in_one(pieces), seed=4)
    expected, found = dict(numbers(whole.metrics)), dict(numbers(scorer.metrics()))
    assert found.keys() == expected.keys()
    for key, value in expected.items():
        assert found[key] == (pytest.approx(value, rel=1e-12) if value is not None else None), key
    place = ["step", "vehicle_id"]
    errors = pd.concat([each[runfolder.ERRORS] for each in tables]).sort_values(place, ignore_index=True)
    pd.testing.assert_frame_equal(errors, whole.errors.sort_values(place, ignore_index=True), check_categorical=False)
    assert whole.metrics["mot"]["truth_n"] > 0


def test_what_the_driver_would_do_is_that_of_the_run_in_one_piece(pieces):
    lanes = tuple(Lane(number=k + 1, right_m=3.6 * k - 1.8, left_m=3.6 * k + 1.8) for k in range(5))
    driven = DriverSetup(driver_of("hdm"), CorridorRoad(lanes=lanes))
    pieces = [
        (truth.assign(speed_mps=truth["speed_mps"] + 5.0 * truth["is_ego"]), seen, tracks[tracks["step"] % STEPS < 50])
        for truth, seen, tracks in pieces
    ]
    scorer = RunScorer(4, driven)
    tables = [scorer.add(*piece) for piece in pieces]
    whole = score_run(*in_one(pieces), seed=4, driven=driven)
    expected, found = (dict(numbers(registry["decisions"])) for registry in (whole.metrics, scorer.metrics()))
    assert found == pytest.approx(expected, nan_ok=True)
    assert expected["missed"] > 0
    for name, table in ((runfolder.BRAKINGS, whole.brakings), (runfolder.COMMANDS, whole.commands)):
        joined = pd.concat([each[name] for each in tables], ignore_index=True)
        pd.testing.assert_frame_equal(joined, table)


def test_a_metric_of_the_whole_run_lets_no_run_come_in_stretches(pieces, monkeypatch):
    monkeypatch.setattr(registry, "METRICS", copy.deepcopy(registry.METRICS))
    assert RunScorer().takes_stretches

    @register("toy")
    def toy(evidence) -> dict[str, object]:
        return {"steps": len(evidence.rows.time_s)}

    scorer = RunScorer()
    assert not scorer.takes_stretches
    scorer.add(*pieces[0])
    with pytest.raises(ValueError, match="stretch by stretch"):
        scorer.add(*pieces[1])
