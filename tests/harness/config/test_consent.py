"""A configuration from elsewhere does not choose which code is run."""

from __future__ import annotations

import sys

import pytest

from harness.common.errors import InputError
from harness.running.finished import read_recorded_run
from harness.running.resolve import resolve_run_config, write_config
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


def test_the_same_holds_for_a_motion_model(download):
    download.write_text(f'[tracker]\nmodel = "{MODULE}.inner:Model"\n')
    with pytest.raises(InputError, match="`model`"):
        resolve_run_config(download)


def test_the_same_holds_for_a_reader_of_recorded_traffic(download, tmp_path):
    (tmp_path / "file.csv").write_text("a,b\n")
    download.write_text(f'replay = "{tmp_path}/file.csv"\n[traffic.recording]\nformat = "{MODULE}:read"\n')
    with pytest.raises(InputError, match=rf"{MODULE}:read.*`format`"):
        resolve_run_config(download)
    assert MODULE not in sys.modules


def test_who_names_it_in_person_gets_it(download, monkeypatch):
    for options, settings in (({"tracker": f"{MODULE}:factory"}, ()), ({}, (f"tracker.name={MODULE}:factory",))):
        assert resolve_run_config(download, options, settings).tracker.name == f"{MODULE}:factory"
    monkeypatch.setenv("PYTHONPATH", str(download.parent))
    assert resolve_run_config(download).tracker.name == f"{MODULE}:factory"


def test_an_installed_module_may_be_named(download):
    download.write_text('[tracker]\nname = "numpy.random:default_rng"\n')
    assert resolve_run_config(download).tracker.name == "numpy.random:default_rng"


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
