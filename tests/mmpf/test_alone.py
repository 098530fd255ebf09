"""The filter runs and installs without the harness and what only the harness needs."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ITS_OWN = "mmpf numpy scipy numba llvmlite pydantic pydantic_core annotated_types typing_extensions typing_inspection"
"""The packages that ``mmpf/pyproject.toml`` names, and what these need."""
SCRIPT = f"""
import sys
from importlib.metadata import packages_distributions

BLOCKED = {{*packages_distributions(), "harness"}} - set("{ITS_OWN}".split())

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ModuleNotFoundError(f"{{name}} is not installed", name=name)

sys.meta_path.insert(0, Absent())
import numpy as np
from mmpf import Detections, EgoPose, FilterOptions, MixtureTracker, Scan, SensorModel, highway, motion_model

options = FilterOptions(update=sys.argv[1], particles=50)
tracker = MixtureTracker(highway(), SensorModel(), motion_model("gmm"), np.random.default_rng(0), options)
for step in range(5):
    at, none = np.array([30.0 + 2.0 * step]), np.full(1, np.nan)
    seen = Detections(at, np.full(1, 9.15), none, np.full(1, 0.3), np.full(1, 0.2), none)
    tracks = tracker.step(Scan(0.1 * step, seen, EgoPose(2.0 * step, 9.15, 0.0, 20.0, 4.7, 1.9)))
print(round(float(tracks.lon_m[0])))
"""


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["joint", "max_likelihood"])
def test_the_filter_tracks_a_car_where_only_its_own_packages_are_installed(rule: str) -> None:
    run = subprocess.run([sys.executable, "-c", SCRIPT, rule], capture_output=True, text=True, check=False, cwd=ROOT)
    assert (run.stdout.strip(), run.stderr) == ("38", "")


def test_its_distribution_says_what_that_of_the_harness_says() -> None:
    alone, both = (
        tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        for folder in (ROOT / "mmpf", ROOT)
    )
    assert set(alone["dependencies"]) <= set(both["dependencies"])
    for key in ("version", "license", "requires-python", "authors"):
        assert alone[key] == both[key]
    assert (ROOT / "mmpf" / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
