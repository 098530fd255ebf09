import gc
import os
import sys
import time

import pytest

from harness.commands.app import run_command_line
from harness.common.exit_codes import WRONG_INPUT
from harness.common.files import write_text
from harness.common.isolation import trusted

# Where bytecode is not kept, each of the many processes of the tests compiles all sources again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


LONGEST = ("examples", "drive", "size", "cluster", "plug_ins", "kills", "readme", "train", "fidelity")


def pytest_collection_modifyitems(items):
    """Begin with what takes longest: begun last, one of these would keep a worker while the others idle."""
    items.sort(key=lambda item: next((k for k, name in enumerate(LONGEST) if f"test_{name}" in item.nodeid), 99))


def pytest_collection_finish():
    """Leave what was collected, which lives to the end, out of every later look for garbage, in forks too."""
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    """Read files in a fast test's own process: a fork takes longer than most of them.

    What lies beside packages, what reads files of others, and what is marked ``forks`` reads them as outside of tests.
    """
    package = item.nodeid.partition("::")[0].split("/")[2:-1]
    if package[:1] in ([], ["storage"], ["truth"]) or any(map(item.get_closest_marker, ("forks", "slow"))):
        return (yield)
    with trusted():
        return (yield)


@pytest.fixture
def read_here():
    """Read files in the process of the test itself where other tests of its folder do not."""
    with trusted():
        yield


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """Return what runs a command in the test's own folder, where it must be refused at once, and hands on its line."""
    monkeypatch.chdir(tmp_path)

    def line_of(*words):
        capsys.readouterr()
        begin = time.perf_counter()
        assert run_command_line([*map(str, words)]) == WRONG_INPUT
        assert time.perf_counter() - begin < 60.0
        told = capsys.readouterr()
        (line,) = told.err.splitlines()
        assert (told.out, line[:7]) == ("", "error: ")
        return line

    return line_of


@pytest.fixture(scope="module")
def no_pictures():
    """Leave out the pictures of runs, grids and drives, which take longer than short ones of these do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.report.pictures.draw_figures", lambda folder, pictured: folder.mkdir())
        for module in ("harness.grid.stress", "harness.closedloop.drive"):
            patch.setattr(f"{module}.draw_charts", lambda charts, title, path: write_text(path, ""))
        yield


@pytest.fixture(scope="module")
def no_shadows():
    """Leave out the sensor's shadows, which take most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.sensor.detector.free_space", lambda *_: None)
        yield
