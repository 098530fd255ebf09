"""Traffic in a window: what is checked before one opens, how its end is told, and that it changes nothing."""

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import pytest

from harness.common.errors import InputError, RunError
from harness.truth.sumo import window
from harness.truth.sumo.session import sumo_errors_in_words
from harness.truth.sumo.window import LOG, SumoWindow, check_window, has_screen

traci = pytest.importorskip("traci", reason="traci speaks to sumo-gui")
XVFB = shutil.which("Xvfb")
on_a_virtual_screen = pytest.mark.skipif(
    XVFB is None or importlib.util.find_spec("sumo") is None, reason="no Xvfb or no sumo-gui on this machine"
)


@pytest.mark.parametrize(
    ("platform", "environment", "there_is_one"),
    [
        ("linux", {}, False),
        ("linux", {"DISPLAY": "", "WAYLAND_DISPLAY": ""}, False),
        ("linux", {"DISPLAY": ":0"}, True),
        ("linux", {"WAYLAND_DISPLAY": "wayland-0"}, True),
        ("darwin", {}, True),
        ("win32", {}, True),
    ],
)
def test_only_linux_tells_by_the_environment_whether_there_is_a_screen(platform, environment, there_is_one):
    assert has_screen(platform, environment) is there_is_one


@pytest.fixture
def screen(monkeypatch):
    monkeypatch.setattr(window, "has_screen", lambda platform, environment: True)


def test_without_a_screen_no_run_begins(tmp_path, monkeypatch, refused):
    monkeypatch.setattr(window, "has_screen", lambda platform, environment: False)
    assert "--gui: no display is available" in refused("run", "--gui")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("missing", ["sumo", "traci"])
def test_without_sumo_gui_the_extra_is_named(screen, missing, tmp_path, monkeypatch, refused):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == missing else find(name, *more))
    told = refused("run", "--gui")
    assert "--gui: sumo-gui is not installed" in told
    assert ".[networks]" in told
    assert list(tmp_path.iterdir()) == []


def test_a_replay_has_nothing_to_open(screen, tmp_path, refused):
    (tmp_path / "fcd.xml").write_text(
        "<fcd-export>" + "".join(
            f'<timestep time="{k / 10}"><vehicle id="a" x="{2 * k}" y="0" angle="90" speed="20"/></timestep>'
            for k in range(20)
        ) + "</fcd-export>"
    )  # fmt: skip
    assert "--gui: --replay" in refused("run", "--gui", "--replay", "fcd.xml")
    assert [path.name for path in tmp_path.iterdir()] == ["fcd.xml"]


@pytest.mark.skipif(importlib.util.find_spec("sumo") is None, reason="no sumo-gui on this machine")
def test_sumo_gui_of_another_version_is_refused_for_it_drives_other_traffic(screen, monkeypatch):
    monkeypatch.setattr(window, "version", {"eclipse-sumo": "1.2", "libsumo": "1.3"}.__getitem__)
    with pytest.raises(InputError, match=r"pip install eclipse-sumo==1\.3"):
        check_window()


def window_that_ended(exit_code: int, errors: str = "") -> SumoWindow:
    complaints = TemporaryDirectory()
    (Path(complaints.name) / LOG).write_text(errors)
    domains = dict.fromkeys(("vehicle", "person", "lane", "edge", "route", "simulation", "trafficlight", "gui"))
    return SumoWindow(
        SimpleNamespace(**domains, close=lambda wait: None),
        subprocess.Popen([sys.executable, "-c", f"raise SystemExit({exit_code})"]),
        complaints,
    )


@pytest.mark.parametrize(("exit_code", "words"), [(0, "the window of sumo-gui was closed"), (9, "exit code 9")])
@pytest.mark.parametrize("error", [traci.FatalTraCIError("x"), BrokenPipeError("x"), ConnectionResetError("x")])
def test_a_window_that_is_gone_is_told_in_words(exit_code, words, error):
    ended = window_that_ended(exit_code)
    with pytest.raises(RunError, match=words), sumo_errors_in_words(ended):
        raise error
    ended.close()
    assert not ended.isLoaded()


def test_what_sumo_gui_wrote_before_it_ended_is_told():
    ended = window_that_ended(1, "some warning\nError: The edge 'x'\n is unknown.\nQuitting (on error).\n")
    assert ended.how_it_ended() == "sumo-gui ended with exit code 1: The edge 'x' is unknown."
    ended.close()


def test_a_command_that_the_window_refuses_is_told_as_it_is():
    importlib.import_module("libsumo")  # which changes traci's exceptions
    ended = window_that_ended(0)
    with pytest.raises(RunError, match="SUMO failed: vehicle 'x' is not known"), sumo_errors_in_words(ended):
        raise traci.TraCIException("vehicle 'x' is not known")
    ended.close()


@pytest.fixture(scope="module")
def environment() -> Iterator[dict[str, str]]:
    """Open a virtual screen and return an environment in which windows open on it."""
    command = [str(XVFB), "-displayfd", "1", "-screen", "0", "1280x800x24", "-nolisten", "tcp"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        yield os.environ | {"DISPLAY": f":{server.stdout.readline().strip()}"}
        server.terminate()


RUN = [sys.executable, "-m", "harness", "run", "--density", "10", "--seed", "3"]


@pytest.mark.slow
@on_a_virtual_screen
def test_the_window_changes_no_byte_of_the_results(environment, tmp_path):
    command = [*RUN, "--duration", "2", "--particles", "50", "--json"]
    subprocess.run([*command, "--out", str(tmp_path / "plain")], capture_output=True, check=True)
    shown = subprocess.run(
        [*command, "--gui", "--out", str(tmp_path / "shown")],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(shown.stdout) == json.loads((tmp_path / "shown" / "metrics.json").read_text())
    for name in ("truth.parquet", "detections.parquet", "tracks.parquet", "errors.parquet", "config.toml"):
        assert (tmp_path / "plain" / name).read_bytes() == (tmp_path / "shown" / name).read_bytes(), name


@pytest.mark.slow
@on_a_virtual_screen
def test_a_window_that_goes_away_leaves_the_finished_steps(environment, tmp_path):
    run = run_until_it_tracks(environment, tmp_path)
    os.kill(window_of(run), signal.SIGTERM)
    _, told = run.communicate(timeout=60)
    assert run.returncode == 3
    assert "sumo-gui ended" in told.splitlines()[-1]
    manifest = json.loads((tmp_path / "run.incomplete" / "manifest.json").read_text())
    assert manifest["status"] == "failed"
    assert manifest["steps"] > 0


def run_until_it_tracks(environment: dict[str, str], folder: Path) -> subprocess.Popen[str]:
    herald = "tests.harness.stand_ins:herald_tracker"
    environment = environment | {"PYTHONPATH": str(Path(__file__).parents[4])}
    run = subprocess.Popen(
        [*RUN, "--gui", "--duration", "600", "--tracker", herald, "--out", "run"],
        cwd=folder,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 180.0
    while not (folder / "under-way").exists():
        assert run.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.1)
    return run


def window_of(run: subprocess.Popen[str]) -> int:
    (gui,) = Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()
    return int(gui)


@pytest.mark.slow
@on_a_virtual_screen
def test_ctrl_c_closes_the_window_and_keeps_the_finished_steps(environment, tmp_path):
    run = run_until_it_tracks(environment, tmp_path)
    gui = window_of(run)
    run.send_signal(signal.SIGINT)
    _, told = run.communicate(timeout=60)
    assert run.returncode == 130
    assert "interrupted after" in told.splitlines()[-1]
    assert (tmp_path / "run.incomplete").is_dir()
    assert not Path(f"/proc/{gui}").exists()
