from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.common.files import write_toml
from harness.lab.study import noise_fit
from harness.lab.study.noise_fit import FACTORS, fit_noise, fit_study
from harness.lab.study.published import MODELS
from harness.lab.study.rival_noise import at_their_best, rivals
from harness.lab.windows.cases import Cases
from mmpf.motion.kinematic import ProcessNoise, kinematic, process_noise
from mmpf.motion.protocol import motion_models
from mmpf.motion.state import ACCEL, LAT, LAT_SPEED, LON, SPEED

STEPS, COUNT, STEP_S = 30, 12, 0.1


def wandering_cases(noise: ProcessNoise) -> Cases:
    """Vehicles whose speeds are driven by white noise, as CVM has it, of a given density."""
    rng = np.random.default_rng(0)
    truth = np.zeros((STEPS, 6, COUNT))
    truth[0, SPEED] = 20.0
    for step in range(1, STEPS):
        kicks = np.sqrt(STEP_S) * rng.standard_normal((2, COUNT)) * [[noise.lon], [noise.lat]]
        truth[step] = truth[step - 1]
        truth[step, [SPEED, LAT_SPEED]] += kicks
        truth[step, [LON, LAT]] += STEP_S * truth[step, [SPEED, LAT_SPEED]]
        truth[step, ACCEL] = 0.0
    return Cases(truth, lambda state, step, unseen: None, STEP_S)  # type: ignore[arg-type, return-value]


def test_every_rival_of_the_studies_is_made_under_its_own_name():
    for name, make in rivals().items():
        assert make(process_noise(name)).name == name
    named = {name for names in MODELS.values() for name in names}
    assert named - set(rivals()) == {name for name in named if name.startswith("gmm")}


def test_restless_vehicles_ask_for_more_noise_than_calm_ones():
    committed = process_noise("cvm")
    calm, restless = (
        fit_noise("cvm", wandering_cases(ProcessNoise(factor * committed.lon, factor * committed.lat)), 100)
        for factor in (0.1, 12.0)
    )
    assert calm.lon < restless.lon
    assert calm.lat < restless.lat
    assert restless.lon / committed.lon in FACTORS


def test_the_fitted_noise_is_used_for_its_study_and_its_models_alone(tmp_path: Path):
    file = tmp_path / "noise.toml"
    write_toml(file, {"lane-change": {"cvm": {"lon": 9.0, "lat": 0.0}}}, "")
    models = {"cvm": kinematic("cvm"), "cam": kinematic("cam"), "gmm": motion_models["idm"]()}
    best = at_their_best(models, "lane-change", file)
    assert best["cam"] is models["cam"]
    assert best["gmm"] is models["gmm"]
    state = np.zeros((6, 400))
    state[SPEED] = 20.0
    moved, _ = best["cvm"].propagate(state, np.zeros((0, 400)), None, 0.1, np.random.default_rng(0))  # type: ignore[arg-type]
    assert moved[SPEED].std() == pytest.approx(9.0 * np.sqrt(0.1), rel=0.1)
    assert at_their_best(models, "lane-keeping", file) == models
    assert at_their_best(models, "lane-change", tmp_path / "none.toml") == models


def test_learned_models_are_no_rivals_to_fit(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(noise_fit, "fit_noise", lambda name, cases: replace(process_noise(name), lon=1.23456))
    said: list[str] = []
    fitted = fit_study(("gmm", "cvm"), wandering_cases(process_noise("cvm")), said.append)
    assert fitted["cvm"]["lon"] == 1.235
    assert list(fitted) == ["cvm"]
    assert len(said) == 1
