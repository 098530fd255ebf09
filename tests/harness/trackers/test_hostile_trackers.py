"""Whatever a tracker from elsewhere does is one line that names it, and what is recorded is not in its hands."""

import os
import re
import signal
import subprocess
import sys
import time

import pandas as pd
import pytest

import harness
from harness.commands.app import run_command_line
from harness.common.watching import watched
from harness.trackers.conformance.checks import tracker_checks
from mmpf.registry import entry_points_of
from tests.harness.recorded_scene import write_recorded_scene
from tests.harness.test_plug_ins import install

pytestmark = pytest.mark.usefixtures("no_pictures")

TRACKS = "replace(Tracks.none(), **{n: np.ones(1, k) for n, k in COLUMNS})"
MODULE = """
import os, sys
from dataclasses import fields, replace
import numpy as np
from mmpf.tracks import Tracks
COLUMNS = [(f.name, "i8" if f.name == "track_id" else "i1" if f.name == "state" else "f8") for f in fields(Tracks)]
def one(**columns):
    return replace({tracks}, **{{n: np.array([v], dtype=np.asarray(v).dtype) for n, v in columns.items()}})
class Bad:
    def step(self, scan):
        {step}
        return one()
def make(setting, options):
    {make}
    return Bad()
"""
UNLIKELY = "warning: this is unlikely: tracks are over 10 m from any vehicle"
STEPS = {
    "sys.exit(0)": "SystemExit: 0",
    "if scan.time_s > 0.45: sys.exit(0)": "SystemExit: 0",
    "raise BaseException('out')": "BaseException: out",
    "raise GeneratorExit": "GeneratorExit",
    "raise BrokenPipeError": "BrokenPipeError",
    "raise MemoryError": "MemoryError",
    "raise type('E', (Exception,), {'__str__': lambda error: 1 / 0})": "E: it has no text, bad.py line 11",
    "if scan.time_s == 0.0 and os.fork() == 0: return one()": "has forked this process at 0",
    "return one(lon_m=1e308)": "lon_m holds 1e+308",
    "return one(track_id=-5)": "track_id holds -5",
    "return one(existence=2.0)": "existence holds 2",
    "return one(existence=-1.0)": "existence holds -1",
    "return one(std_lon_m=-1.0)": "std_lon_m holds -1",
    "return one(std_lat_m=0.0)": "std_lat_m holds 0",
    "return one(std_speed_mps=-3.0)": "std_speed_mps holds -3",
    "return one(track_id=1.5)": "track_id is float64, not whole numbers",
    "return one(state=1.0)": "state is float64, not whole numbers",
    "return one(state=np.int8(7))": "state holds 7",
    "return one(lon_m=np.float16('inf'))": "lon_m holds inf",
    "return replace(one(), lon_m=np.ma.masked_all(1))": "lon_m is MaskedArray, not an array",
    "return Tracks(*(np.arange(300_000, dtype=k) for _, k in COLUMNS))": "",
    "return replace(one(), **{n: np.ones(20_000, k) for n, k in COLUMNS})": "there are 20000 tracks",
}


def complaints(told):
    return [line for line in told.splitlines() if not line.startswith(UNLIKELY)]


@pytest.fixture
def scene(tmp_path_factory):
    return write_recorded_scene(tmp_path_factory.mktemp("scenes") / "scene")


def written(folder, scene, name, step="pass", make="pass"):
    """Write the tracker and return the words of a run with it."""
    (folder / "bad.py").write_text(MODULE.format(tracks=TRACKS, step=step, make=make))
    return ["run", "--replay", str(scene), "--tracker", name, "--quiet", "--out", str(folder / "out")]


def run_with(folder, scene, monkeypatch, step="pass", make="pass", words=()):
    run = written(folder, scene, "bad:make", step, make)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.delitem(sys.modules, "bad", raising=False)
    return run_command_line([*words] or run)


def test_a_tracker_that_takes_stdout_away_is_checked_to_the_end(tmp_path, scene, monkeypatch, capsys):
    assert run_with(tmp_path, scene, monkeypatch, "sys.stdout = None", words=("check-tracker", "bad:make")) == 3
    assert capsys.readouterr().out.count("\n") == len(tracker_checks())


@pytest.mark.parametrize("words", [("check-tracker", "bad:make"), ("export", "SCENE", "--to", "bad:make")])
def test_what_somebody_elses_code_prints_is_not_on_stdout(words, tmp_path, scene, monkeypatch, capfd):
    words = [str(scene) if word == "SCENE" else word for word in words]
    run_with(tmp_path, scene, monkeypatch, make="os.system('echo noise')", words=(*words, "--json"))
    told = capfd.readouterr()
    assert ("noise" in told.out, "noise" in told.err) == (False, True)


@pytest.mark.parametrize("step", STEPS)
def test_what_a_tracker_does_in_a_step_is_one_line_with_its_file_and_line(step, tmp_path, scene, monkeypatch, capfd):
    code = run_with(tmp_path, scene, monkeypatch, step)
    (line,) = complaints(capfd.readouterr().err)
    assert "Bad (bad.py line 9)" in line
    assert STEPS[step] in line
    assert code == (0 if "fork" in step else 3)
    assert not list(tmp_path.glob(".out*"))


def of_a_fork(folder, scene, **steps):
    """Return what a watched command says on stderr and its exit code, in a fork of this process."""
    told, words = folder / "told", written(folder, scene, "bad:make", **{"step": "pass", **steps})
    leave = os._exit  # before what is watched replaces it
    if not (child := os.fork()):
        code = 99
        try:
            os.closerange(3, 256)  # as in a new process
            sys.modules.pop("bad", None)
            sys.path.insert(0, str(folder))
            sys.stdout = sys.stderr = told.open("w")
            os.dup2(sys.stderr.fileno(), 2)
            code = watched("harness.commands.app:run_command_line", words)
        finally:
            leave(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), told.read_text()


@pytest.mark.parametrize(
    ("where", "does"),
    [
        ("step", "os.close(1); os.closerange(60, 256)"),
        pytest.param("make", "sys.stdout = sys.stderr = None", marks=pytest.mark.slow),
    ],
)
def test_what_a_tracker_does_to_the_streams_has_no_effect(where, does, tmp_path, scene):
    process = started(tmp_path, scene, name="bad:make", **{"step": "pass", where: does})
    assert not complaints(process.communicate(timeout=120)[1])
    assert process.returncode == 0


@pytest.mark.parametrize("where", ["step", "make"])
def test_a_tracker_that_goes_to_another_folder_moves_no_results(where, tmp_path, scene, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    words = ("run", "--replay", str(scene), "--tracker", "bad:make", "--quiet", "--out", "out")
    assert run_with(tmp_path, scene, monkeypatch, words=words, **{where: "os.chdir('..')"}) == 0
    assert (tmp_path / "here" / "out" / "metrics.json").is_file()


@pytest.mark.parametrize("where", ["step", pytest.param("make", marks=pytest.mark.slow)])
def test_a_tracker_that_closes_files_of_the_run_is_named(where, tmp_path, scene):
    code, told = of_a_fork(tmp_path, scene, **{where: "os.closerange(0, 60)"})
    assert code == 3
    assert "bad:make" in told


LEAVES = "pass\nsys.exit(0)\ndef other():\n    pass"
ASKED = "return type('Prop', (), {'step': property(lambda self: 1 / 0)})()"
MAKES = ("sys.exit(0)", "raise BaseException", "raise KeyError('x')", "return None", LEAVES, ASKED)


@pytest.mark.parametrize("make", MAKES)
def test_what_a_factory_or_its_module_does_is_one_line(make, tmp_path, scene, monkeypatch, capfd):
    assert run_with(tmp_path, scene, monkeypatch, make=make) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert ("can't import the tracker 'bad:make' (SystemExit: 0)" if make == LEAVES else "--tracker bad:make: ") in line


def test_a_tracker_changes_neither_what_is_recorded_nor_the_road_that_is_scored(tmp_path, scene, monkeypatch):
    write = "d = scan.detections; d.lon_m.flags.writeable = True; d.lon_m[:] = 5.0"
    before = pd.read_parquet(scene / "detections.parquet")
    make = "object.__setattr__(setting.road, 'section_m', (0.0, 1.0))"
    assert run_with(tmp_path, scene, monkeypatch, write, make) == 0
    after = pd.read_parquet(tmp_path / "out" / "detections.parquet")
    assert after["lon_m"].tolist() == before["lon_m"].tolist()
    assert (scene / "road.json").read_text() == (tmp_path / "out" / "road.json").read_text()


def started(folder, scene, step, name, make="pass"):
    words = written(folder, scene, name, step, make)
    install(folder, "bad-trackers", {"harness.trackers": {"bad-one": "bad:make"}})
    paths = os.pathsep.join((str(folder), *filter(None, sys.path)))
    return subprocess.Popen(
        [sys.executable, "-m", "harness", *words],
        env={**os.environ, "PYTHONPATH": paths},
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )


@pytest.mark.slow
def test_how_deep_a_tracker_lets_calls_go_has_no_effect(tmp_path, scene):
    lowers = "import traceback; sys.setrecursionlimit(len([*traceback.walk_stack(sys._getframe())]) + 9)"
    process = started(tmp_path, scene, lowers, "bad:make")
    assert not complaints(process.communicate(timeout=120)[1])
    assert process.returncode == 0


EXITS = ("os._exit(0)", "bad.py line 11 ended the process by os._exit(0)")
KILLS = ("if os.fork() == 0: os.kill(os.getppid(), 9)", "crashed (SIGKILL)")
CRASHES = ("__import__('ctypes').string_at(0)", "crashed (SIGSEGV)")


@pytest.mark.slow
@pytest.mark.parametrize(("step", "end", "name"), [(*EXITS, "bad-one"), (*CRASHES, "bad:make")])
def test_a_tracker_that_ends_the_process_is_one_line(step, end, name, tmp_path, scene):
    process = started(tmp_path, scene, step, name)
    told = process.communicate(timeout=120)[1].splitlines()
    assert process.returncode == 3
    assert told[-1].startswith("error: bad")
    assert end in told[-1]
    assert sum(line.startswith("error:") for line in told) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("step", "told", "name"), [(*KILLS, "bad-one"), ("raise KeyError('x')", "KeyError: 'x'", "bad:make")]
)
def test_a_tracker_that_ends_the_process_of_a_call_from_python_raises_an_error_there(
    step, told, name, tmp_path, scene, monkeypatch, request
):
    written(tmp_path, scene, name, step)
    install(tmp_path, "bad-trackers", {"harness.trackers": {"bad-one": "bad:make"}})
    request.addfinalizer(entry_points_of.cache_clear)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "bad", raising=False)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(harness.RunError, match=re.escape(told)):
        harness.run(replay=scene, tracker=name, out=tmp_path / "out")
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.slow
@pytest.mark.parametrize(("end", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_command_with_a_tracker_from_elsewhere_ends_by_signals_as_others_do(end, code, tmp_path, scene):
    here = tmp_path / "here"
    process = started(tmp_path, scene, f"open({str(here)!r}, 'w').close(); __import__('time').sleep(60)", "bad:make")
    while not here.exists() and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(end)
    told = process.communicate(timeout=60)[1].splitlines()
    assert process.returncode == code
    assert len(told) == 1
    assert told[0].startswith("interrupted")
