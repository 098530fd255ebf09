"""The ablation study: arms are real settings of the tracker, and differences are paired."""

import pandas as pd
import pytest
from scipy.stats import t as student

from harness.grid.grid import plan_grid
from harness.lab import ablation
from harness.running.open import check_named_code
from harness.sensor.profiles import sensor_settings


def runs_with(hota: dict[str, list[float]], failed: tuple[str, int] | None = None) -> pd.DataFrame:
    rows = []
    for variant in ablation.ABLATIONS:
        for seed, value in enumerate(hota.get(variant, hota[ablation.DEFAULT])):
            row = {"variant": variant, "seed": seed, "succeeded": (variant, seed) != failed}
            rows.append(row | {measure.key: value for measure in ablation.ablated_quantities()})
    return pd.DataFrame(rows).sample(frac=1.0, random_state=1)


def test_every_arm_is_a_setting_that_the_tracker_takes():
    grid = plan_grid(ablation.ablation_request("us101", "0:2", 60.0))
    assert [run.variant for run in grid.cells[0].runs] == list(ablation.ABLATIONS)
    for run in grid.cells[0].runs:
        check_named_code(run.config)


def test_both_readings_with_the_papers_own_models_are_run_under_the_papers_sensor_too():
    grid = plan_grid(ablation.ablation_request("us101", "0:2", 60.0, ablation.IDEAL_ABLATIONS, ablation.IDEAL_SENSOR))
    variants = [run.variant for run in grid.cells[0].runs]
    assert variants == list(ablation.IDEAL_ABLATIONS)
    models = ("", "+model=gmm-short", "+model=gsm")
    assert {reading + model for reading in (ablation.PAPER, ablation.CHARITABLE) for model in models} < set(variants)
    for run in grid.runs:
        sensor = sensor_settings(run.config.sensor.profile, run.config.sensor.overrides)
        assert (sensor.detection_probability, sensor.view_exponent) == (1.0, 0.0)
        failings = ("clutter_per_scan", "persistent_clutter", "missed_far_share", "burst_share", "bias_share")
        assert [getattr(sensor, name) for name in failings] == [0.0] * len(failings)


def test_arms_are_compared_with_the_default_seed_by_seed():
    # Seeds differ by far more than the arms do; pairing takes that out.
    arm = list(ablation.ABLATIONS)[1]
    rows = {
        row["variant"]: row
        for row in ablation.ablation_rows(runs_with({ablation.DEFAULT: [90.0, 50.0, 70.0], arm: [89.0, 49, 69]}))
    }
    cell = rows[arm]["mot.hota"]
    assert (cell["mean"], cell["difference"], cell["ci95"]) == (69.0, -1.0, (-1.0, -1.0))
    assert rows[ablation.DEFAULT]["mot.hota"]["difference"] == 0.0


def test_a_seed_whose_run_failed_is_left_out_of_the_pairs():
    arm = list(ablation.ABLATIONS)[2]
    runs = runs_with({ablation.DEFAULT: [90.0, 50.0, 70.0], arm: [80.0, 0.0, 65.0]}, failed=(arm, 1))
    row = next(row for row in ablation.ablation_rows(runs) if row["variant"] == arm)
    assert row["runs"] == 2
    assert row["mot.hota"]["difference"] == pytest.approx(-7.5)
    half = student.isf(0.025, 1) * 2.5  # the differences are -10 and -5
    assert row["mot.hota"]["ci95"] == pytest.approx((-7.5 - half, -7.5 + half), abs=1e-4)


def test_the_table_names_every_arm_in_words():
    runs = runs_with({ablation.DEFAULT: [90.0, 80.0]})
    page = ablation.as_markdown(
        ablation.ablation_rows(runs), ablation.ablation_rows(runs, ablation.IDEAL_ABLATIONS), "made up"
    )
    for variant, what in ablation.ABLATIONS.items():
        assert page.count(f"| {what} |") == (2 if variant in ablation.IDEAL_ABLATIONS else 1)
