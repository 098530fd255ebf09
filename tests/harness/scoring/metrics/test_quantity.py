"""A quantity is found in the content of a metrics.json by its dotted key."""

import numpy as np
import pandas as pd
import pytest

from harness.analysis import coasting_ratio
from harness.analysis.curves import ratio_of, summed_by, sums_and_weights
from harness.common.intervals import possible_ci
from harness.scoring.metrics import closedloop
from harness.scoring.metrics.quantity import Quantity
from harness.scoring.metrics.registry import quantities
from harness.scoring.score import RunScorer
from harness.storage.grid_folder import flattened
from tests.harness.scoring.scenes import Scene, score_run, traffic

METRICS = {"mae": {"hidden": {"lon_m": 2, "n": None}, "text": "x"}, "flat": 1.5}
MISSING = ("mae.hidden.n", "mae.hidden.lat_m", "gone.hidden.lon_m", "flat.deeper")


@pytest.mark.parametrize(
    ("key", "value"), [("mae.hidden.lon_m", 2.0), ("flat", 1.5), *((key, None) for key in MISSING)]
)
def test_a_quantity_is_a_number_or_none(key, value):
    found = Quantity(key, "a label").of(METRICS)
    assert found == value
    assert found is None or isinstance(found, float)


def test_a_metric_from_outside_says_how_its_runs_are_pooled_and_which_value_is_best():
    said = Quantity("toy.of", "said of", best=1.0, pooled=lambda column: (column("toy.said"), column("toy.there")))
    runs = pd.DataFrame({"toy.said": [1.0, 6.0], "toy.there": [4.0, 6.0], "toy.of": [0.25, 1.0]})
    assert (ratio_of(*sums_and_weights(runs, said))[0], said.better) == (pytest.approx(7.0 / 10.0), "near 1")


# Counts a run, HOTA, order statistics, and the largest gap, of which a run alone has another least sample.
OF_RUNS = ("missed", "false_tracks", "hota", "worst_tenth", "_report_s", "_reported", "dropped", "largest_gap")


def test_runs_of_different_lengths_are_pooled_to_the_score_of_both_together():
    runs = [traffic(steps, 30, seed=seed) for seed, steps in enumerate((60, 150))]
    together = RunScorer()
    for truth, detections, tracks in runs:
        tracks.loc[::3, "speed_mps"] = np.nan  # a track may leave it open
        together.add(truth, detections, tracks)
    expected = pd.Series(flattened(together.metrics()))
    table = pd.DataFrame([flattened(score_run(*run).metrics) for run in runs])
    table = table.assign(**{"timing.steps": [60, 150], "seed": [0, 1]})
    known = [each for each in quantities() if np.isfinite(expected.get(each.key, np.nan))]
    for each in known:
        if not each.key.endswith(OF_RUNS) and each.scale is None:
            pooled = ratio_of(*summed_by("seed", table, *sums_and_weights(table, each)))[0]
            assert pooled == pytest.approx(expected[each.key]), each.key
    assert {"mae.hidden.speed_mps", "motion.visible.jerk_mps3", "mot_all.idf1"} <= {each.key for each in known}


def test_a_track_that_leaves_its_speed_open_counts_for_positions_alone():
    scene = Scene(10).vehicle("a", 20.0, detected=True).track(1, 20.5, speed=np.where(np.arange(10) < 4, np.nan, 12.0))
    found = score_run(*scene.tables()).metrics["mae"]["visible"]
    assert (found["n"], found["speed_n"], found["speed_mps"], found["lon_m"]) == (10, 6, 2.0, 0.5)


SIGNED = ("mot.mota", "never_seen.log_skill_percent")  # below 0 where errors outweigh what is right
MOST = {", %": 100.0, ", percentage points": 100.0, ", °": 180.0, "Brier score": 1.0}


@pytest.mark.parametrize(
    "quantity", [*quantities(), *coasting_ratio.QUANTITIES, *closedloop.QUANTITIES], ids=lambda each: each.key
)
def test_an_interval_holds_only_values_that_its_unit_can_have(quantity):
    least = -np.inf if quantity.key in SIGNED else 0.0
    is_cost = quantity.key.endswith(("cost_m", "crps_m"))  # of a vehicle without a track it is 10 m
    (most,) = [most for unit, most in MOST.items() if quantity.label.endswith(unit)] or [10.0 if is_cost else np.inf]
    assert (quantity.possible.least, quantity.possible.most) == (least, most)
    for values in ([0.0, 0.0, 1.0], [0.0, most, most]):
        if np.isfinite(values).all():
            interval = possible_ci(np.array(values), np.ones(3), quantity.possible)
            assert least <= interval.low < interval.high <= most
