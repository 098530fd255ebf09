import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from harness.commands import app
from harness.commands.app import other_checkout, run_command_line
from harness.commands.from_options import typed
from harness.common.errors import InputError, RunError, RunInterruptedError
from mmpf.registry import UnknownNameError
from tests.harness.recorded_scene import write_recorded_scene

ROOT = Path(__file__).parents[3]


def complaint(arguments: list[str], capsys) -> tuple[int, str, str]:
    """Return the exit code, stdout and stderr of a command."""
    code = run_command_line(arguments)
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["run", "--density", "0"], "--density"),
        (["run", "--force"], "--force"),
        (["run", "--density", "1_0"], "--density"),
        (["run", "--set", "sensor.range_m='1_0'"], "sensor.range_m"),
        (["stress", "--workers", "1_0"], "--workers"),
        (["run", "--particles", "2.5"], "--particles"),
        (["train", "--duration", "inf"], "--duration"),
        (["train", "--seed", "4294967296"], "--seed"),
        (["bench", "--budget", "nan"], "--budget"),
        (["bench", "--against", "HEAD", "--budget", "1"], "--budget"),
        (["bench", "--out", str(ROOT / "README.md")], "--out"),
        (["study", "ablation", "--out", str(ROOT / "README.md" / "study")], "--out"),
        (["study", "ablation", "--particles", "50"], "--particles"),
        (["study", "situations", "--real-data", "here", "--seeds", "0:1"], "--seeds"),
        (["drive", "--timeout-per-run", "1e999"], "--timeout-per-run"),
        (["run", "--set", "nonsense"], "--set"),
        (["run", "--unknown"], "--unknown"),
        (["run", "--video", "--out", "run"], "--video: needs a value"),
        (
            ["compare", "a", "b", "--json", "out.json"],
            "--json: takes no file, it prints on stdout; write --json > out.json",
        ),
        (["run", "--json=out.json"], "--json: takes no file"),
        (["run", "surplus"], "surplus"),
        (["nosuch"], "nosuch"),
        (["settings", "nonsense"], "nonsense"),
        (["--nosuch"], "--nosuch"),
    ],
)
def test_wrong_input_is_told_in_one_line(arguments, named, tmp_path, refused):
    assert named in refused(*arguments)
    assert not list(tmp_path.rglob("*.parquet"))


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (InputError("x"), 2),
        (UnknownNameError("x"), 2),
        (RunError("x"), 3),
        (RunInterruptedError("x"), 130),
        (KeyboardInterrupt(), 130),
        (OSError(errno.ENAMETOOLONG, "File name too long", "x" * 300), 2),
        (PermissionError(errno.EACCES, "Permission denied", "report.html"), 2),
        (OSError(errno.ENOSPC, "No space left on device", "x"), 3),
        (MemoryError(), 3),
        (IndexError("list index out of range"), 70),
        (RuntimeError("two\nlines"), 70),
    ],
)
def test_each_kind_of_error_has_its_exit_code(error, code, capsys, monkeypatch):
    def fail() -> None:
        raise error

    monkeypatch.setattr("harness.commands.nets.command", fail)
    exit_code, _, err = complaint(["nets"], capsys)
    assert exit_code == code
    assert len(err.splitlines()) == 1


def test_an_installed_copy_says_so_where_the_user_stands_in_a_checkout(tmp_path, monkeypatch, capsys):
    for name in ("harness/__main__.py", "mmpf/__init__.py", "docs/page.md"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).touch()
    assert other_checkout(tmp_path / "docs", tmp_path) is None
    assert other_checkout(tmp_path.parent, Path("/elsewhere")) is None
    monkeypatch.chdir(tmp_path / "docs")
    assert run_command_line(["--version"]) == 0
    assert f"not the checkout {tmp_path} that you stand in" in capsys.readouterr().err


def test_what_needs_no_folder_works_where_the_working_folder_was_deleted(tmp_path, monkeypatch, capsys):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert complaint(["nets"], capsys)[::2] == (0, "")
    assert complaint(["report", "run"], capsys)[::2] == (2, "error: RUN: there is no folder run\n")


def test_overview_loads_nothing_heavy():
    heavy = "libsumo pandas numba matplotlib sklearn stonesoup scipy pyarrow numpy pydantic"
    script = (
        "import sys; from harness.commands.app import run_command_line as run; code = run(['--help']);"
        f"print(code, [name for name in '{heavy}'.split() if name in sys.modules], file=sys.stderr)"
    )
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert answer.stderr.strip() == "0 []"
    assert "python -m harness run --net us101" in answer.stdout


def test_a_python_without_the_libraries_is_told_so_in_one_line():
    answer = subprocess.run([sys.executable, "-S", "-m", "harness"], capture_output=True, text=True, check=False)
    assert (answer.returncode, answer.stdout, answer.stderr.count("\n")) == (2, "", 1)
    assert "activate the environment" in answer.stderr


@pytest.mark.parametrize(
    ("name", "value", "words", "told"),
    [("NUMBA_NUM_THREADS", "0", "nets", (2, 1)), ("PYTHONIOENCODING", "ascii", "settings radar", (0, 0))],
)
def test_what_the_environment_says_of_threads_and_letters_is_met(name, value, words, told):
    command, environment = [sys.executable, "-m", "harness", *words.split()], {**os.environ, name: value}
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (answer.returncode, answer.stderr.count("\n")) == told


def test_every_listed_command_can_be_called_for_help(capsys):
    assert {"run", "nets"} <= set(app.COMMANDS)
    for name in app.COMMANDS:
        code, out, _ = complaint([name, "--help"], capsys)
        assert code == 0
        assert name in out
        assert "<bool>" not in out, "flags take no value"


def test_nets_lists_networks_and_demands_for_people_and_programs(capsys):
    code, out, _ = complaint(["nets"], capsys)
    assert code == 0
    assert "us101-0805" in out
    code, out, _ = complaint(["nets", "--json"], capsys)
    assert "us101" in {network["name"] for network in json.loads(out)}


def test_a_misspelt_network_is_refused_before_anything_slow_is_imported():
    call = "from harness.commands.app import run_command_line as call; call(['run', '--net', 'us102'])"
    code = f"import sys; {call}; print(sorted({{'numpy', 'pandas', 'matplotlib'}} & set(sys.modules)))"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (answer.stdout, "--net us102: no such network" in answer.stderr) == ("[]\n", True)


@pytest.mark.parametrize(("words", "is_run"), [(["nets"], False), (["check-tracker", "numexpr:none"], True)])
def test_a_module_of_the_working_folder_is_run_only_where_it_is_named(words, is_run, tmp_path):
    (tmp_path / "numexpr.py").write_text("open('run', 'w').close()")  # pandas looks for this one
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    told = subprocess.run([sys.executable, "-m", "harness", *words], cwd=tmp_path, env=environment, check=False)
    assert (told.returncode, (tmp_path / "run").exists()) == (2 * is_run, is_run)


@pytest.mark.slow
def test_json_is_all_that_is_on_stdout(tmp_path):
    command = ["run", "--density", "5", "--duration", "1", "--particles", "50", "--json"]
    words = [sys.executable, "-m", "harness", *command, "--out", str(tmp_path / "run")]
    answer = subprocess.run(words, capture_output=True, text=True, check=True)
    assert json.loads(answer.stdout) == json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert "Results:" in answer.stderr


@pytest.mark.slow
def test_a_backend_of_matplotlib_that_there_is_none_of_costs_a_run_only_its_pictures(tmp_path):
    words = ["--replay", str(write_recorded_scene(tmp_path / "scene")), "--tracker", "detections", "--quiet"]
    command = [sys.executable, "-m", "harness", "run", *words, "--out", str(tmp_path / "run")]
    answer = subprocess.run(command, env={**os.environ, "MPLBACKEND": "no"}, capture_output=True, text=True, check=True)
    assert f"warning: the run is complete in {tmp_path / 'run'} but not drawn (ValueError: " in answer.stderr
    assert not (tmp_path / "run" / "figures").exists()


@pytest.mark.slow
@pytest.mark.parametrize(("end", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_an_end_from_outside_leaves_a_readable_folder_that_says_so(end, code, tmp_path):
    traffic, tracker = ["--density", "5", "--duration", "600"], "tests.harness.stand_ins:herald_tracker"
    process = subprocess.Popen(
        [sys.executable, "-m", "harness", "run", *traffic, "--tracker", tracker, "--out", "run"],
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        # Shells start background jobs with Ctrl-C ignored, nohup does so with SIGHUP, and a child inherits that.
        preexec_fn=lambda: signal.signal(end, signal.SIG_DFL),  # noqa: PLW1509
    )
    deadline = time.monotonic() + 180.0
    while not (tmp_path / "under-way").exists():
        assert process.poll() is None
        assert time.monotonic() < deadline, "the run is not under way yet"
        time.sleep(0.05)
    process.send_signal(end)
    _, err = process.communicate(timeout=60.0)
    assert process.returncode == code, err
    assert len(err.strip().splitlines()) == 1 or "interrupted" in err
    assert "Traceback" not in err
    assert {entry.name for entry in tmp_path.iterdir()} == {"run.incomplete", "under-way"}
    steps = {
        name: pd.read_parquet(tmp_path / "run.incomplete" / f"{name}.parquet")["step"].max()
        for name in ("truth", "tracks")
    }
    manifest = json.loads((tmp_path / "run.incomplete" / "manifest.json").read_text())
    assert manifest["status"] == "interrupted"
    assert steps["truth"] == steps["tracks"] == manifest["steps"] - 1 >= 10
    assert not (tmp_path / "run.incomplete" / "metrics.json").exists()


@pytest.mark.parametrize(
    ("program", "typed_as"), [("there/harness/__main__.py", "python -m harness"), ("bin/mmpf-harness", "mmpf-harness")]
)
def test_a_command_is_recorded_as_it_is_typed(monkeypatch, program, typed_as):
    monkeypatch.setattr("sys.argv", [program, "run", "--out", "my run"])
    assert typed() == f"{typed_as} run --out 'my run'"
