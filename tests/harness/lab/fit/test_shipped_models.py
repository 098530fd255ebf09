"""The models that travel with the package were fitted to the present traffic."""

import re
from importlib.resources import files

import pytest

from harness.lab.windows.recording import traffic_version
from harness.truth.network.network import load_network

MODELS = [entry for entry in files("mmpf.models").iterdir() if entry.name.endswith((".npz", ".toml"))]


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_a_shipped_model_was_fitted_to_the_present_traffic(model):
    card = files("mmpf.models").joinpath(f"{model.name.rpartition('.')[0]}.md")
    text = (card if card.is_file() else model).read_text(encoding="utf-8")
    told = re.search(r"Traffic(?:\*\*)?: (.+)", text)
    assert told is not None, f"{model.name}: neither file nor card says which traffic it was fitted to"
    for version in told.group(1).split(", "):
        present = traffic_version(load_network(version.partition("-")[0]))
        assert version == present, f"{model.name} was fitted to {version}, the traffic is {present}: run `train` again"
