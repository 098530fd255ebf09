"""Models that are read from files are tried: drivers pass, and what takes no notice of others does not."""

from pathlib import Path

import pytest

from mmpf.motion.gmm.model_file import ModelFileError, committed_file, load_arrays, save_arrays
from mmpf.motion.learned.driver import load_learned_driver, residual_driver
from mmpf.motion.learned.trial import check_that_it_drives
from mmpf.motion.protocol import motion_models

DRIVERS = [name for name in motion_models.own if name.startswith("idm")]
FITTED = ["gmm", "residual", "recurrent", "empirical", "gmm-short", "gsm"]


@pytest.mark.parametrize("name", DRIVERS + FITTED)
def test_published_and_committed_drivers_pass(name):
    check_that_it_drives(motion_models[name](), Path("own.npz"))


@pytest.mark.parametrize("name", ["cvm", "cam", "csav", "csaa"])
def test_what_does_not_brake_for_others_is_no_driver(name):
    with pytest.raises(ModelFileError, match=r"own\.npz: no driver: at"):
        check_that_it_drives(motion_models[name](), Path("own.npz"))


@pytest.mark.parametrize(
    ("case", "load", "name", "change", "words"),
    [
        ("lane-keeping", load_learned_driver, "following.output_scale", lambda values: 100.0 * values, "no driver"),
        ("lane-keeping", load_learned_driver, "lateral", lambda values: 100.0 * values, "aside"),
        ("residual", residual_driver, "w3", lambda values: -10.0 * values, "no driver"),
    ],
)
def test_a_file_whose_numbers_are_no_drivers_is_refused(case, load, name, change, words, tmp_path):
    with committed_file(case) as path:
        arrays = load_arrays(path, case)
    save_arrays(tmp_path / "own.npz", arrays | {name: change(arrays[name])})
    with pytest.raises(ModelFileError, match=words):
        check_that_it_drives(load(tmp_path / "own.npz"), tmp_path / "own.npz")
