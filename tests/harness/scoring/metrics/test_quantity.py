"""A quantity is found in the content of a metrics.json by its dotted key."""

from __future__ import annotations

import pytest

from harness.scoring.metrics.quantity import Quantity

METRICS = {"mae": {"hidden": {"lon_m": 2, "n": None}, "text": "x"}, "flat": 1.5}


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("mae.hidden.lon_m", 2.0),
        ("flat", 1.5),
        ("mae.hidden.n", None),
        ("mae.hidden.lat_m", None),
        ("gone.hidden.lon_m", None),
        ("flat.deeper", None),
    ],
)
def test_a_quantity_is_a_number_or_none(key, value):
    found = Quantity(key, "a label").of(METRICS)
    assert found == value
    assert found is None or isinstance(found, float)
