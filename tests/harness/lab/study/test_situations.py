"""The study by situation: who is in which, and a table whose numbers are those of the models."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.lab.study import situations
from harness.lab.study.study import StudyPlan, model_of
from mmpf.motion.learned.empirical import load_empirical, save_empirical
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
        assert f"| {row['lon_m']:.2f}; " in text, "one recording says nothing of others, so there is no interval"
    assert text.count("| cvm |") == len({row["situation"] for row in rows})
    assert "| 1 s | 2 s | 5 s | 10 s |" in text
    assert np.isfinite([row["lon_m"] for row in rows]).all()


def test_the_one_chosen_model_is_read_from_the_users_file(tmp_path):
    """A file of halved accelerations takes the place of the bundled one, and no other model's."""
    bundled = model_of(StudyPlan("situations"), "empirical", keeps_lane=True).model.follower
    path = tmp_path / "mine.npz"
    save_empirical(path, replace(bundled, changes_mps2=0.5 * bundled.changes_mps2))
    plan = StudyPlan("situations", ("empirical",), model_file=path)
    follower = model_of(plan, "empirical", keeps_lane=True).model.follower
    np.testing.assert_array_equal(follower.changes_mps2, load_empirical(path).changes_mps2)
    assert not np.array_equal(follower.changes_mps2, bundled.changes_mps2)
    several = replace(plan, models=("empirical", "cvm"))
    kept = model_of(several, "empirical", keeps_lane=True).model.follower
    np.testing.assert_array_equal(kept.changes_mps2, bundled.changes_mps2)


def test_a_file_for_a_model_that_is_read_from_none_is_refused():
    with pytest.raises(InputError, match="cvm is not read from a file"):
        model_of(StudyPlan("situations", ("cvm",), model_file=Path("mine.npz")), "cvm", keeps_lane=True)
