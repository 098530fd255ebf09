"""The transfer study: what it trains and tests on, what it says of who loses, and the whole on made-up recordings."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from harness.commands.app import run_command_line
from harness.common.errors import InputError
from harness.lab.fit import driver_fit
from harness.lab.study import transfer
from harness.lab.study.transfer import (
    TransferPlan,
    held_out,
    make_transfer_study,
    mixed,
    snippet_windows,
    split_pairs,
)
from harness.lab.study.transfer_outcomes import (
    ON_NOTHING,
    ON_SUMO,
    TrainedModel,
    TransferOutcome,
    compare_transfer,
    summary_lines,
)
from harness.lab.study.transfer_text import as_json, write_transfer
from harness.lab.windows.filtering import follow
from harness.lab.windows.pairs import pair_windows
from harness.lab.windows.scores import mean_with_interval, score
from harness.truth.network.network import load_network
from mmpf.motion.kinematic import ProcessNoise, kinematic
from tests.harness.lab.fit.recorded_pairs import write_pairs
from tests.harness.truth.recorded.layouts import Car, ngsim_rows, write_ngsim_csv

REAL = Path(os.environ.get("MMPF_REALDATA", "no recordings"))
STEP_S = 0.1
STILL = ProcessNoise(0.0, 0.0)


@pytest.fixture(scope="module")
def windows(tmp_path_factory):
    return pair_windows(write_pairs(tmp_path_factory.mktemp("pairs") / "pairs.parquet"), 101, STEP_S)


def test_no_pair_is_both_trained_and_tested_on_and_none_is_lost(windows):
    training, held_out = split_pairs(windows, 0)
    assert not set(training.vehicle) & set(held_out.vehicle)
    assert set(training.vehicle) | set(held_out.vehicle) == set(windows.vehicle)
    assert len(training) + len(held_out) == len(windows)
    assert abs(len(set(training.vehicle)) - len(set(held_out.vehicle))) <= 1


def test_too_few_pairs_are_refused(windows):
    with pytest.raises(InputError, match="at least 4"):
        split_pairs(windows.take(np.flatnonzero(windows.vehicle < 3)), 0)


def test_mixed_traffic_is_half_real_and_keeps_the_vehicles_apart(windows):
    real, simulated = windows.take(np.arange(3)), windows.take(np.arange(3, len(windows)))
    both = mixed(simulated, real, 12, 0)
    assert len(both) == 24
    np.testing.assert_array_equal(both.lon_m[12:], real.lon_m[np.arange(12) % 3])
    assert not set(both.vehicle[:12]) & set(both.vehicle[12:])


def test_every_file_of_recorded_traffic_is_told_with_its_vehicles(tmp_path):
    cars = (Car(1, 40.0, 9.0, 10.0), Car(2, 70.0, 9.0, 10.0))
    files = [write_ngsim_csv(tmp_path / f"{name}.csv", ngsim_rows(cars)) for name in "ab"]
    told: list[str] = []
    windows = snippet_windows(files, 51, told.append)
    assert [line.split(":")[0] for line in told] == ["a.csv", "b.csv"]
    assert all("2 vehicles, of which 1 follow" in line for line in told)
    assert len(np.unique(windows.vehicle)) == 2


def test_recordings_without_a_follower_are_refused(tmp_path):
    path = write_ngsim_csv(tmp_path / "a.csv", ngsim_rows((Car(1, 40.0, 9.0, 10.0),)))
    with pytest.raises(InputError, match="follows another"):
        snippet_windows([path], 51, lambda line: None)


def test_intervals_resample_whole_vehicles():
    """Ten vehicles with a hundred equal cases each tell no more than ten cases."""
    values = np.random.default_rng(0).normal(size=10)
    _, (low, high) = mean_with_interval(values, np.random.default_rng(1), np.arange(10))
    repeated = np.repeat(values, 100), np.repeat(np.arange(10), 100)
    mean, (low_repeated, high_repeated) = mean_with_interval(repeated[0], np.random.default_rng(1), repeated[1])
    assert mean == pytest.approx(values.mean())
    assert (low_repeated, high_repeated) == pytest.approx((low, high))


def outcome(windows, name, trained_on, model) -> TransferOutcome:
    test = held_out("real pairs", windows, (1.0, 10.0))
    scores = score(follow(model, test.cases, 2, np.random.default_rng(0)), test.cases)
    return TransferOutcome(TrainedModel(name, trained_on, model), test, scores)


def test_where_a_simulated_model_loses_the_study_says_so(windows):
    """Swinging traffic: constant acceleration is better than constant speed at 1 s and worse at 10 s."""
    outcomes = [
        outcome(windows, "gmm", ON_SUMO, kinematic("cam", STILL)),
        outcome(windows, "cvm", ON_NOTHING, kinematic("cvm", STILL)),
    ]
    comparisons = compare_transfer(outcomes)
    assert [comparison.better for comparison in comparisons] == [True, False]
    (line,) = [line for line in summary_lines(comparisons) if "cvm at" in line]
    assert line.startswith("- on real pairs, gmm, sumo loses to cvm at 10 s")


def test_a_model_held_against_itself_is_neither_better_nor_clearly_worse(windows):
    outcomes = [
        outcome(windows, "gmm", ON_SUMO, kinematic("cvm", STILL)),
        outcome(windows, "cvm", ON_NOTHING, kinematic("cvm", STILL)),
    ]
    for comparison in compare_transfer(outcomes):
        assert not comparison.better
        assert not comparison.clear


@pytest.mark.parametrize("folder", ["", "nowhere"])
def test_without_real_recordings_the_study_ends_with_two_and_one_line(folder, capsys, monkeypatch):
    monkeypatch.setenv("MMPF_REALDATA", folder)
    assert run_command_line(["study", "transfer"]) == 2
    message = capsys.readouterr().err.strip()
    assert "--real-data" in message
    assert len(message.splitlines()) == 1


@pytest.fixture
def little(monkeypatch, windows, tmp_path) -> TransferPlan:
    """Fit little, and put made-up windows in SUMO's place."""
    for name, value in (("FOLLOWING_SAMPLES", 3000), ("SHORT_SAMPLES", 3000), ("ROLLOUTS", 10)):
        monkeypatch.setattr(driver_fit, name, value)
    monkeypatch.setattr(transfer, "COMPONENTS", 3)
    monkeypatch.setattr("harness.lab.fit.unrolled.ITERATIONS", 2)
    monkeypatch.setattr("harness.lab.fit.rival_fit.GENERATIONS", 1)
    monkeypatch.setattr(transfer, "_simulated_windows", lambda *arguments: windows)
    cars = tuple(Car(k, 40.0 + 30.0 * k, 9.0, 8.0, to_s=11.0) for k in range(1, 5))
    (tmp_path / "ngsim").mkdir()
    write_ngsim_csv(tmp_path / "ngsim" / "scene.csv", ngsim_rows(cars))
    write_pairs(tmp_path / "car_following_pairs.parquet")
    return TransferPlan(tmp_path, particles=4)


@pytest.mark.slow
def test_the_whole_study_gives_every_model_on_every_test_set_and_says_how(little, tmp_path):
    steps: list[int] = []
    result = make_transfer_study(little, load_network("us101"), lambda line: None, lambda: steps.append(1))
    assert len(steps) == transfer.PREDICTIONS
    wanted = {"study", "occlusion", "model", "horizon_s", "lon_m", "lon_m_ci95", "trained_on", "tested_on", "n"}
    assert all(wanted <= set(row) for row in result.rows())
    keys = {(row["model"], row["trained_on"], row["tested_on"], row["horizon_s"]) for row in result.rows()}
    assert len(keys) == len(result.rows()) == 15 * 3 * 4
    write_transfer(result, tmp_path / "out")
    stored = json.loads((tmp_path / "out" / "results.json").read_text())
    assert stored == json.loads(json.dumps(as_json(result)))
    assert "# Study: transfer\n\n- on real pairs" in (tmp_path / "out" / "results.md").read_text()
    again = make_transfer_study(little, load_network("us101"), lambda line: None, lambda: None)
    assert again.rows() == result.rows()


@pytest.mark.skipif(not (REAL / "car_following_pairs.parquet").is_file(), reason="no real pairs; set MMPF_REALDATA")
def test_real_pairs_are_all_read_and_their_speeds_are_those_of_their_positions():
    windows = pair_windows(REAL / "car_following_pairs.parquet", 101, STEP_S)
    assert len(np.unique(windows.vehicle)) == 142
    assert windows.has_leader.all()
    for position, speed in ((windows.lon_m, windows.speed_mps), (windows.leader_lon_m, windows.leader_speed_mps)):
        travelled = position[:, -1] - position[:, 0]
        np.testing.assert_allclose(travelled, np.trapezoid(speed, dx=STEP_S, axis=1), atol=0.5)
