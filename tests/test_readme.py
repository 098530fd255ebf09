"""The examples of the Python pages are run as they stand, and the README stays short."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HARNESS, FILTER = (
    re.search(r"```python\n(.*?)```", (ROOT / "docs" / "reference" / page).read_text(encoding="utf-8"), re.DOTALL)[1]
    for page in ("python-harness.md", "python-mmpf.md")
)


def test_the_readme_has_at_most_eighty_lines() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 80


@pytest.mark.slow
def test_the_harness_from_python_runs_and_compares_as_on_its_page(tmp_path: Path) -> None:
    words = [sys.executable, "-c", HARNESS]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=True, cwd=tmp_path)
    score, page = done.stdout.split()
    assert 80.0 < float(score) <= 100.0
    assert (tmp_path / page).is_file()


@pytest.mark.slow
def test_the_filter_alone_tracks_the_two_cars_of_its_page() -> None:
    done = subprocess.run([sys.executable, "-c", FILTER], capture_output=True, text=True, timeout=120, check=True)
    numbers = [float(number) for number in re.findall(r"[-+.\d]+", done.stdout)]
    assert len(numbers) == 6, done.stdout
    names, positions, speeds = numbers[:2], numbers[2:4], numbers[4:]
    assert names[0] != names[1]
    assert all(abs(a - b) < 0.5 for a, b in zip(sorted(positions), (83.0, 127.8), strict=True))
    assert all(18.0 < speed < 24.0 for speed in speeds)
