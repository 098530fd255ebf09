"""What the learned models are meant to reach, held against the results that are committed."""

import json
from pathlib import Path

import pytest

from harness.lab.study.study import COMPLETE, HORIZONS_S, PARTIAL

REFERENCE = Path(__file__).parents[4] / "results" / "reference"
OURS, PAPER, PAPER_CHANGE = "gmm", "gmm-short", "gmm-lane-change"


def results(study: str, occlusion: str, horizon_s: float | None) -> dict[str, dict]:
    """Return the committed rows by model; without a horizon, the means over all steps."""
    rows = json.loads((REFERENCE / f"study-{study}" / "results.json").read_text())["results"]
    return {row["model"]: row for row in rows if (row["occlusion"], row["horizon_s"]) == (occlusion, horizon_s)}


def is_smallest(rows: dict[str, dict], quantity: str, model: str = OURS) -> bool:
    return all(rows[model][quantity] < row[quantity] for name, row in rows.items() if name != model)


@pytest.mark.parametrize("horizon_s", HORIZONS_S)
def test_ours_errs_least_and_says_how_much_when_nothing_is_seen(horizon_s):
    rows = results("lane-keeping", COMPLETE, horizon_s)
    assert is_smallest(rows, "lon_m")
    assert is_smallest(rows, "crps_lon_m")
    assert 0.90 <= rows[OURS]["coverage95_lon_m"] <= 0.98


@pytest.mark.parametrize("horizon_s", [horizon for horizon in HORIZONS_S if horizon >= 2.0])
def test_ours_is_clearly_better_than_the_intelligent_driver(horizon_s):
    rows = results("lane-keeping", COMPLETE, horizon_s)
    assert rows[OURS]["lon_m_ci95"][1] < rows["idm"]["lon_m_ci95"][0]


@pytest.mark.parametrize("horizon_s", [horizon for horizon in HORIZONS_S if horizon <= 5.0])
def test_the_papers_model_is_better_than_the_kinematic_ones_up_to_5_s(horizon_s):
    rows = results("lane-keeping", COMPLETE, horizon_s)
    assert rows[PAPER]["lon_m"] < min(rows["cvm"]["lon_m"], rows["cam"]["lon_m"])


def test_ours_has_less_than_a_third_of_constant_velocitys_error_at_5_s():
    rows = results("lane-keeping", COMPLETE, 5.0)
    assert rows[OURS]["lon_m"] < rows["cvm"]["lon_m"] / 3


def test_ours_errs_least_with_narrow_and_honest_particles_under_partial_occlusion():
    rows = results("lane-keeping", PARTIAL, None)
    assert is_smallest(rows, "lon_m")
    assert is_smallest(rows, "speed_mps")
    assert rows[OURS]["spread_lon_m"] < rows["cvm"]["spread_lon_m"]
    assert 0.90 <= rows[OURS]["coverage95_lon_m"] <= 0.99


@pytest.mark.parametrize("horizon_s", [5.0, None], ids=["at the crossing", "over the change"])
@pytest.mark.parametrize(("model", "other"), [(OURS, PAPER_CHANGE), (PAPER_CHANGE, OURS)])
def test_either_learned_model_is_better_than_all_kinematic_ones_in_a_lane_change(model, other, horizon_s):
    rows = results("lane-change", PARTIAL, horizon_s)
    rows.pop(other)
    assert is_smallest(rows, "lat_speed_mps", model)
    assert is_smallest(rows, "speed_mps", model)
