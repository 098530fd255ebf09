"""A quantity is found in the content of a metrics.json by its dotted key."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from harness.analysis import coasting_ratio
from harness.analysis.curves import ratio_of, sums_and_weights
from harness.common.intervals import possible_ci
from harness.scoring.metrics import closedloop
from harness.scoring.metrics.quantity import Quantity
from harness.scoring.metrics.registry import quantities
from tests.harness.scoring.scenes import Scene, score_run

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
    is_cost = quantity.key.endswith("cost_m")  # of a vehicle without a track it is 10 m
    (most,) = [most for unit, most in MOST.items() if quantity.label.endswith(unit)] or [10.0 if is_cost else np.inf]
    assert (quantity.possible.least, quantity.possible.most) == (least, most)
    for values in ([0.0, 0.0, 1.0], [0.0, most, most]):
        if np.isfinite(values).all():
            interval = possible_ci(np.array(values), np.ones(3), quantity.possible)
            assert least <= interval.low < interval.high <= most
