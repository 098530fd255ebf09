"""The study by situation: who is in which, and a table whose numbers are those of the models."""

from dataclasses import replace

import numpy as np
import pytest

from harness.lab.study import situations
from harness.lab.study.published import StudyPlan
from tests.harness.lab.windows.test_windows import ROAD, changing, steady, traffic


@pytest.fixture
def rows():
    """Four brake by 0.5 m/s² behind each other; far behind them two change lanes and do so too."""
    convoy = [*((60.0 * k, 20.0, steady(2.0)) for k in range(4)), *((-300.0 * k, 20.0, changing(100)) for k in (1, 2))]
    steadily = traffic(*convoy, steps=201)
    time_s = 0.1 * steadily.step
    braking = replace(
        steadily,
        lon_m=steadily.lon_m - 0.25 * time_s**2,
        speed_mps=steadily.speed_mps - 0.5 * time_s,
        accel_mps2=np.full(len(steadily), -0.5),
    )
    plan = StudyPlan("situations", ("cvm", "idm"), particles=400)
    return situations.situation_rows(plan, [(braking, ROAD)], 101, lambda: None)


def test_the_error_of_constant_velocity_is_what_braking_makes_it(rows):
    of = {(row["situation"], row["model"], row["horizon_s"]): row for row in rows}
    assert {situation for situation, _, _ in of} == {"following", "changing lanes"}
    for situation, cases in (("following", 3), ("changing lanes", 2)):
        for horizon_s in (2.0, 5.0, 10.0):
            row = of[situation, "cvm", horizon_s]
            assert row["lon_m"] == pytest.approx(0.25 * horizon_s**2, rel=0.1)
            assert row["n"] == cases


def test_the_page_has_a_table_for_each_situation_with_every_model_and_horizon(rows):
    text = situations.as_markdown(rows, {"network": "one"})
    for row in rows:
        assert f"## {row['situation'].capitalize()}, {row['n']} cases" in text
        assert f"{row['lon_m']:.2f} [" in text
    assert text.count("| cvm |") == len({row["situation"] for row in rows})
    assert "| 1 s | 2 s | 5 s | 10 s |" in text
    assert np.isfinite([row["lon_m"] for row in rows]).all()
