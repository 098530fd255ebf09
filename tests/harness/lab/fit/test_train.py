"""The train command refuses what makes no sense, and trains end to end on little traffic."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.lab.fit import driver_fit, train
from harness.lab.fit.train import TrainingPlan
from harness.lab.fit.turning_fit import train_turning
from harness.truth.network.network import load_network
from mmpf.motion.gmm.model_file import committed_mixture
from mmpf.motion.learned.driver import load_learned_driver
from mmpf.motion.learned.lane_changer import CHANGE
from mmpf.motion.learned.short_driver import SHORT


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--case", "parking"], "--case parking"),
        (["--seeds", "0:5"], "kept for tuning and reporting"),
        (["--seeds", "5:5"], "a range A:B"),
        (["--net", "nowhere"], "nowhere"),
        (["--case", "turning", "--net", "us101"], "--net us101: give networks in the plane"),
        (["--case", "turning", "--net", "junction,us102"], "--net us102: no such network"),
        (["--densities", "20,200"], "--densities 200: give 5 to 65"),
        (["--densities", "20,20"], "a value stands there twice"),
        (["--case", "turning", "--duration", "60"], "takes the demands of its networks"),
        *(
            (["--case", case, "--components", "9"], f"--components: the case {case} fits no mixture")
            for case in ("turning", "residual", "recurrent", "empirical")
        ),
    ],
)
def test_wrong_input_ends_with_two_and_one_line(arguments, words, refused):
    assert words in refused("train", *arguments)


@pytest.mark.slow
def test_training_end_to_end_leaves_models_that_load_and_cards(tmp_path, monkeypatch):
    for name, value in (("FOLLOWING_SAMPLES", 2000), ("SHORT_SAMPLES", 2000), ("ROLLOUTS", 10)):
        monkeypatch.setattr(driver_fit, name, value)
    monkeypatch.setattr("harness.lab.windows.recording.TUNING_DURATION_S", 30.0)
    monkeypatch.setattr("harness.lab.fit.rival_fit.GENERATIONS", 1)
    places = tmp_path / "cache", tmp_path / "models"
    plan = TrainingPlan("lane-keeping", 4, range(1000, 1001), 0, *places, densities=(8.0, 22.0), duration_s=40.0)
    said: list[str] = []
    paths = train.train(plan, load_network("us101"), said.append)
    assert load_learned_driver(paths[0]).model.follower.following.mixture.inputs == 6
    assert SHORT.load(paths[1]).mixture.outputs == 4
    with pytest.raises(InputError, match="0 windows of car following are too few"):
        train.train(replace(plan, duration_s=10.0, densities=(8.0,)), load_network("us101"), said.append)
    again = train.train(plan, load_network("us101"), said.append)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in paths]
    assert sum(line.startswith("recorded") for line in said) == 5
    card = (tmp_path / "models" / "lane_keeping.md").read_text()
    assert "following" in card
    assert train.KEEPING_LIMITS[0] in card
    assert "of each seed 40 s at each of 8, 22 vehicles" in card
    assert "--densities 8,22 --duration 40" in card
    assert np.isfinite(load_learned_driver(paths[0]).model.follower.following.mixture.means).all()


def test_a_fit_that_its_reader_would_refuse_says_that_there_is_too_little_traffic(tmp_path, monkeypatch):
    sound = committed_mixture(CHANGE)
    fitted = replace(sound, scaling=sound.scaling._replace(input_high=np.full(CHANGE.inputs, np.inf)))
    samples = {"load_changes": range(60), "change_samples": ((), ())}
    monkeypatch.setattr(train.recording, "record_traffic", lambda *_: [])
    for name, made in {**samples, "fit_mixture": fitted}.items():
        monkeypatch.setattr(train, name, lambda *_, made=made: made)
    plan = TrainingPlan("lane-change", 4, range(1000, 1001), 0, None, tmp_path / "models", duration_s=25.0)
    with pytest.raises(InputError, match=r"^`duration` 25: too little traffic .*; give more of `duration` or `seeds`$"):
        train.train(plan, load_network("us101"), str)
    assert not (tmp_path / "models").exists()


@pytest.mark.slow
def test_the_driver_by_the_map_is_fitted_end_to_end_to_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr("harness.lab.fit.turning_fit.DURATION_S", 40.0)
    monkeypatch.setattr("harness.lab.fit.turning_fit.FEWEST", 5)
    networks = [load_network(name) for name in ("junction", "roundabout")]
    paths = [
        train_turning(networks, range(1000, 1002), tmp_path / "cache", tmp_path / name, lambda line: None)
        for name in ("one", "two")
    ]
    fitted = tomllib.loads(paths[0].read_text())
    assert 1.0 < fitted["turning_mps2"] < 4.0
    assert 0.8 < fitted["pace"] < 1.1
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert "junction,roundabout" in paths[0].with_suffix(".md").read_text()
