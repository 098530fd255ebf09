import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path

import pytest

from harness.commands import app
from harness.commands.app import run_command_line
from harness.common import exit_codes
from harness.common.signals import code_of_end, ends_like_ctrl_c

READS_A_DATACLASS = """
import sys
from harness.common.signals import code_of_end, ends_like_ctrl_c

with ends_like_ctrl_c():
    try:
        exec("import os, signal, time; os.kill(os.getpid(), signal.{end}); time.sleep(9)")
    except KeyboardInterrupt:
        code = code_of_end()
sys.exit(code)
"""


@pytest.fixture(autouse=True)
def _hang_up_is_heard():
    """Take back what ``nohup`` would have the tests inherit."""
    previous = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, previous)


@pytest.mark.parametrize(("end", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_what_ends_a_process_from_outside_is_an_interrupt_with_a_code_of_its_own(end, code, monkeypatch, capsys):
    monkeypatch.setattr("harness.commands.nets.command", lambda: os.kill(os.getpid(), end))
    assert run_command_line(["nets"]) == code
    assert capsys.readouterr().err == "interrupted\n"
    assert signal.getsignal(end) is signal.SIG_DFL


@pytest.mark.parametrize(("end", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_the_code_is_the_same_while_a_library_runs_code_that_it_wrote_itself(end, code, tmp_path):
    (tmp_path / "told.py").write_text(READS_A_DATACLASS.format(end=end))
    ended = subprocess.run(
        [sys.executable, "-m", "told"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        check=False,
    )
    assert ended.returncode == code


def test_an_error_that_a_library_makes_of_a_signal_is_an_interrupt(monkeypatch, capsys):
    def swallowing() -> None:
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        except KeyboardInterrupt:
            raise ImportError("half a module") from None

    monkeypatch.setattr("harness.commands.nets.command", swallowing)
    assert run_command_line(["nets"]) == exit_codes.TERMINATED
    assert capsys.readouterr().err == "interrupted\n"


def test_a_signal_that_comes_while_python_calls_back_is_heard_after_it(monkeypatch, capsys):
    def calling_back() -> None:
        gone = threading.Lock()
        kept = weakref.ref(gone, lambda _: os.kill(os.getpid(), signal.SIGTERM))
        del gone
        time.sleep(9)
        assert kept

    monkeypatch.setattr("harness.commands.nets.command", calling_back)
    assert run_command_line(["nets"]) == exit_codes.TERMINATED
    assert capsys.readouterr().err == "interrupted\n"


def test_a_signal_that_comes_while_modules_are_read_ends_without_a_traceback():
    # Whoever starts the tests in the background lets them ignore SIGINT.
    heard = "signal.signal(signal.SIGINT, signal.default_int_handler)"
    held = "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT]); signal.raise_signal(signal.SIGINT)"
    words = [sys.executable, "-c", f"import signal; {heard}; {held}; from harness.__main__ import main; main()", "nets"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (exit_codes.INTERRUPTED, "", "")


@pytest.mark.parametrize(
    "leaves",
    [
        "threading.Thread(target=time.sleep, args=(60,)).start()",
        "atexit.register(print, 'later')",
        "pool = multiprocessing.Pool(2); pool.map(abs, [1, 2]); pool.terminate()",
    ],
)
def test_what_a_finished_command_leaves_behind_neither_holds_it_up_nor_is_heard(leaves, tmp_path):
    imports, told = "import atexit, multiprocessing, threading, time", "print('done')\n    return 7"
    (tmp_path / "left.py").write_text(f"{imports}\ndef work(words):\n    {leaves}\n    {told}\n")
    call = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from harness.common.watching import watched"
    words = [sys.executable, "-c", f"{call}; sys.exit(watched('left:work', []))"]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=30, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr.replace("later\n", "")) == (7, "done\n", "")


def test_a_call_that_a_process_of_its_own_makes_is_given_functions_of_the_working_folder(tmp_path):
    (tmp_path / "mine.py").write_text("def make():\n    pass\n")
    imports = "import mine; from harness.common.watching import survived"
    call = f"{imports}; print(survived('builtins:callable', (mine.make,), ''))"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    words = [sys.executable, "-c", call]
    ended = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert (ended.stdout, ended.stderr) == ("True\n", "")


def test_a_signal_that_is_ignored_as_under_nohup_stays_ignored():
    previous = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ends_like_ctrl_c():
            os.kill(os.getpid(), signal.SIGHUP)
        assert code_of_end() == exit_codes.INTERRUPTED
    finally:
        signal.signal(signal.SIGHUP, previous)


def test_a_fault_of_the_program_is_one_line_and_on_demand_a_traceback(monkeypatch, capsys):
    monkeypatch.setattr("harness.commands.nets.command", lambda: {}["gone"])
    assert run_command_line(["nets"]) == exit_codes.INTERNAL
    assert capsys.readouterr().err.count("\n") == 1
    monkeypatch.setenv(app.TRACEBACK, "1")
    assert run_command_line(["nets"]) == exit_codes.INTERNAL
    assert "Traceback" in capsys.readouterr().err
