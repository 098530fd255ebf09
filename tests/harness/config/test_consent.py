"""A configuration from elsewhere does not choose which code is run."""

from __future__ import annotations

import sys

import pytest

from harness.config.layers import resolve_run_config
from harness.errors import InputError

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
