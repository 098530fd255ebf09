import importlib
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harness.trackers.catalogue import available_trackers, build_tracker
from harness.trackers.conformance.checks import check_tracker
from harness.trackers.conformance.scripted_scenes import ROAD, SENSOR
from harness.trackers.protocol import TrackerSetting

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "tracker.md"


def code_blocks() -> list[str]:
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.fixture
def documented_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    tracker, its_tests = code_blocks()
    (tmp_path / "my_tracker.py").write_text(tracker, encoding="utf-8")
    (tmp_path / "test_my_tracker.py").write_text(its_tests, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_tracker", raising=False)
    return tmp_path


def test_the_documented_tracker_passes_the_suite(documented_module: Path):
    check_tracker(importlib.import_module("my_tracker").NearestNeighbour)


def test_the_documented_tracker_is_built_by_its_dotted_path_with_its_options(documented_module: Path):
    setting = TrackerSetting(ROAD, SENSOR, np.random.default_rng(0))
    assert build_tracker("my_tracker:NearestNeighbour", setting, {"gain": 0.25}).gain == 0.25


@pytest.mark.slow
def test_the_documented_tests_run_and_pass(documented_module: Path):
    finished = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_my_tracker.py"],
        cwd=documented_module,
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stdout


def test_the_page_lists_every_built_in_tracker():
    listed = set(re.findall(r"^\| `([a-z][a-z-]+)` \|", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE))
    assert listed == set(available_trackers())
