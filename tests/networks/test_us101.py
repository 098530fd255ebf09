"""The committed network is what its sources build."""

import importlib.util
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "networks" / "us101"


@pytest.mark.slow
def test_the_built_network_is_what_the_sources_give(tmp_path, monkeypatch):
    pytest.importorskip("sumo", reason="netconvert comes with the networks extra")
    specification = importlib.util.spec_from_file_location("build_us101", FOLDER / "build.py")
    builder = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(builder)
    monkeypatch.setattr(builder, "BUILT", tmp_path / "us101.net.xml")
    builder.build()
    assert (tmp_path / "us101.net.xml").read_text() == (FOLDER / "us101.net.xml").read_text()
