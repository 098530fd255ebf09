import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def installed_from(source: Path, tmp_path: Path) -> Path:
    """Build a wheel of a folder and return where it is unpacked."""
    pytest.importorskip("hatchling")
    pytest.importorskip("build")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path), str(source)]
    subprocess.run(build, check=True, capture_output=True)
    installed = tmp_path / "installed"
    with zipfile.ZipFile(next(tmp_path.glob("*.whl"))) as wheel:
        wheel.extractall(installed)
    return installed


@pytest.mark.slow
def test_the_wheel_of_the_filter_alone_has_its_models_and_names_but_not_its_build_files(tmp_path):
    installed = installed_from(ROOT / "mmpf", tmp_path)
    assert not {"pyproject.toml", "LICENSE"} & {entry.name for entry in (installed / "mmpf").iterdir()}
    script = "import mmpf; mmpf.motion_model('gmm'); mmpf.MixtureTracker; print(mmpf.__file__)"
    answer = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(answer.stdout.strip()) == installed / "mmpf" / "__init__.py"


@pytest.mark.slow
def test_the_wheel_holds_both_packages_and_nothing_beside_them(tmp_path):
    installed = installed_from(ROOT, tmp_path)  # .ci/run makes runs of it from an empty folder
    top = {entry.name for entry in installed.iterdir() if not entry.name.endswith(".dist-info")}
    assert top == {"harness", "mmpf"}
    assert (installed / "harness" / "networks" / "us101" / "network.toml").is_file()


def test_all_files_name_the_same_version():
    places = {
        "pyproject.toml": r'^version = "(.+)"$',
        "mmpf/pyproject.toml": r'^version = "(.+)"$',
        "CITATION.cff": r"^version: (.+)$",
        ".ci/release/conda/recipe.yaml": r'^  version: "(.+)"$',
    }
    found = {re.search(line, (ROOT / name).read_text(), re.MULTILINE).group(1) for name, line in places.items()}
    assert len(found) == 1
    assert f"## [{found.pop()}]" in (ROOT / "CHANGELOG.md").read_text()
