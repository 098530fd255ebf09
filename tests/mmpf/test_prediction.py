"""The noise that the filter adds to a motion model's prediction."""

from __future__ import annotations

import pytest

from mmpf.options import FilterOptions, speed_error


@pytest.mark.parametrize(
    ("model", "update", "expected"),
    [("gmm", "joint", 0.0), ("gmm", "max_likelihood", 0.4), ("cvm", "joint", 0.4), ("my-own", "joint", 0.4)],
)
def test_only_the_learned_driver_under_the_smoothing_rule_needs_no_noise_on_the_speed(
    model: str, update: str, expected: float
) -> None:
    assert speed_error(FilterOptions.model_validate({"update": update}), model) == expected


def test_a_noise_on_the_speed_that_was_asked_for_holds_for_every_model() -> None:
    options = FilterOptions.model_validate({"model_error": {"speed": 0.1}})
    assert speed_error(options, "gmm") == speed_error(options, "cvm") == 0.1
