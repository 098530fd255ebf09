"""A configuration from elsewhere does not choose which code is run."""

import sys

import pytest

from harness.common.errors import InputError
from harness.config.layers import keys_of_code
from harness.config.model import RunConfig
from harness.running.finished import read_recorded_run
from harness.running.resolve import resolve_run_config, write_config
from harness.running.run import run
from harness.trackers.mmpf import MixtureTrackerOptions
from mmpf.options.base import fields_of
from tests.harness.recorded_scene import write_recorded_scene

MODULE = "came_along"
CODE = "raise SystemExit('imported')\n"


@pytest.fixture
def download(tmp_path, monkeypatch):
    """Return a configuration that names a module beside it; Python is started in that folder."""
    (tmp_path / f"{MODULE}.py").write_text(CODE)
    (tmp_path / "config.toml").write_text(f'[tracker]\nname = "{MODULE}:factory"\n')
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    monkeypatch.setattr(sys, "path", [str(tmp_path), "", *sys.path])
    return tmp_path / "config.toml"


def test_a_module_of_the_working_folder_that_only_the_file_names_is_refused_and_not_imported(download):
    with pytest.raises(InputError, match=rf"{MODULE}:factory.*`tracker`"):
        resolve_run_config(download)
    assert MODULE not in sys.modules


def text_keys():
    """Return every setting that a text may be given for, those in open tables too."""
    named = {key for key, field in fields_of(RunConfig) if "str" in str(field.annotation)}
    options = {f"tracker.options.{key}" for key, field in fields_of(MixtureTrackerOptions)}
    return sorted(named - {"replay", "traffic.net", "traffic.demand", "tracker.model_file"} | options)


@pytest.mark.parametrize("key", text_keys())
def test_no_setting_of_a_file_has_code_imported(key, download, tmp_path):
    replay = f'replay = "{write_recorded_scene(tmp_path / "run")}"\n' if key == "traffic.recording.format" else ""
    download.write_text(f'{replay}{key} = "{MODULE}:thing"\n')
    with pytest.raises(InputError):
        run(resolve_run_config(download), out=tmp_path / "out")
    assert MODULE not in sys.modules


@pytest.mark.parametrize("name", [f"{MODULE}:thing", "numpy.random:default_rng", "exec:touch file", "os:abort"])
@pytest.mark.parametrize("key", sorted(keys_of_code()))
def test_a_file_never_chooses_code_whether_installed_or_not(key, name, download):
    download.write_text(f'{key} = "{name}"\n')
    with pytest.raises(InputError, match=f"{key} = {name}, and using that runs code"):
        resolve_run_config(download)


@pytest.mark.parametrize("option", ["tracker", "model", "sensor", "format", "driver"])
def test_what_is_part_of_python_is_not_called_whoever_names_it(option, tmp_path):
    replay = {"replay": str(tmp_path / "file.csv")} if option == "format" else {}
    (tmp_path / "file.csv").write_text("a,b\n")
    with pytest.raises(InputError, match=f"`{option}`.*subprocess:call is part of Python itself"):
        run(resolve_run_config(options={option: "subprocess:call"} | replay), out=tmp_path / "out")


def test_who_names_it_in_person_gets_it(download):
    for options, settings in (({"tracker": f"{MODULE}:factory"}, ()), ({}, (f"tracker.name={MODULE}:factory",))):
        assert resolve_run_config(download, options, settings).tracker.name == f"{MODULE}:factory"


def test_a_name_without_a_module_is_no_matter(download):
    download.write_text('[tracker]\nname = "oracle-kalman"\n')
    assert resolve_run_config(download).tracker.name == "oracle-kalman"


def with_sensor(folder, sensor):
    """Return a run's folder whose configuration names a sensor."""
    config = write_recorded_scene(folder) / "config.toml"
    config.write_text(config.read_text().replace('profile = "lidar"', f'profile = "{sensor}"'))
    return folder


@pytest.mark.parametrize("sensor", [f"{MODULE}:profile", "an-entry-point"])
def test_no_folder_of_a_run_chooses_a_sensor_that_would_be_imported(sensor, download, tmp_path):
    folder = with_sensor(tmp_path / "theirs", sensor)
    with pytest.raises(InputError, match=rf"`folder`.*{sensor}"):
        read_recorded_run(folder)
    with pytest.raises(InputError, match=rf"`replay`.*{sensor}"):
        resolve_run_config(options={"replay": str(folder)})
    assert MODULE not in sys.modules
    asked = resolve_run_config(options={"replay": str(folder), "sensor": sensor})
    assert asked.sensor.profile == sensor


def test_a_folder_made_with_a_sensor_from_outside_is_read_where_there_is_no_such_module(tmp_path, monkeypatch):
    (tmp_path / "my_sensors.py").write_text(
        "from harness.sensor.profiles import SensorSettings\n"
        "def near():\n    return SensorSettings(range_m=70.0, std_length_m=None)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    config = resolve_run_config(options={"sensor": "my_sensors:near", "seed": 7, "duration": 6.0, "model": "cvm"})
    folder = write_recorded_scene(tmp_path / "run")
    write_config(config, folder / "config.toml")
    monkeypatch.delitem(sys.modules, "my_sensors")
    (tmp_path / "my_sensors.py").unlink()
    assert (read_recorded_run(folder).sensor.range_m, read_recorded_run(folder).sensor.std_length_m) == (70.0, None)
    assert resolve_run_config(options={"replay": str(folder)}).sensor.profile == "my_sensors:near"
