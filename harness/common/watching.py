"""Runs work that may load external code in a child process, and reports in one line if that code ends it."""

import os
import pickle
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from pkgutil import resolve_name
from types import FrameType
from typing import Any, NoReturn

from harness.common.errors import InputError, RunError, RunInterruptedError
from harness.common.exit_codes import RUN_FAILED
from harness.common.isolation import end_with_parent
from harness.common.signals import CODES, code_of_end, ends_like_ctrl_c
from harness.common.streams import flush, open_missing_streams
from mmpf.registry import SET_ASIDE

LONGEST_END_S = 2.0
"""So long what external code has started may go on once the work is done."""
NAMES_CODE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")


def code_named(arguments: Sequence[str]) -> list[str]:
    """Return what among the words of a command may be ``module:attribute``, alone, in a list or behind ``KEY=``."""
    words = (word.rpartition("=")[2].strip("\"'[] ") for text in arguments for word in text.split(","))
    return [word for word in words if NAMES_CODE.fullmatch(word)]


def set_folder_aside() -> None:
    """Let modules come from the working folder, where Python looks first, only once a plug-in is asked for.

    Libraries look for optional modules of common names, such as ``yaml``, and would run whatever there has that name.
    """
    with suppress(OSError):  # the folder was deleted
        here = Path.cwd()
        if sys.path[0] in ("", str(here)) and here != Path(__file__).resolve().parents[2]:
            del sys.path[0]
            SET_ASIDE.append(str(here))


def watched(command: str, arguments: Sequence[str]) -> int:
    """Run a command in a child process and return its exit code; in the child this returns as well.

    Code that only an entry point or a file names is loaded without a word that shows it, so every command is watched.

    Args:
        command: ``module:function``, which takes the command's words and returns an exit code.
    """
    open_missing_streams()
    set_folder_aside()
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="replace")  # a terminal may know few letters
    if hasattr(sys.stderr, "reconfigure"):
        # Lines of several processes mix unless each is one write, which PYTHONUNBUFFERED=1 prevents.
        sys.stderr.reconfigure(line_buffering=True, write_through=False)
    handed_on = (*CODES, signal.SIGTSTP)
    child, pipe, mask = _fork(handed_on)
    if not child:
        with ends_like_ctrl_c():
            _tell_of_exits(pipe)
            try:
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)
                code = int(resolve_name(command)(arguments))
            except KeyboardInterrupt:
                code = code_of_end()
            # All is done and told: what ends the process from here on must not look like an error.
            for end in CODES:
                signal.signal(end, signal.SIG_IGN)
        _tell(pipe, (code, None))
        return code
    named = ", ".join(code_named(arguments)) or "a plug-in or a library that the command uses"
    try:
        return _told(child, pipe, mask, handed_on, named)
    except RunError as error:
        sys.stderr.write(f"error: {error}\n")
        return RUN_FAILED


def survived(function: str, arguments: tuple[object, ...], named: str) -> Any:  # noqa: ANN401
    """Return what a function returns that a process of its own calls, which is started for it.

    A fork would inherit the locks of threads that the caller may have, and might wait for them for ever.

    Args:
        function: ``module:attribute``; what it takes and returns goes through ``pickle``.
        named: The external code that it uses, for messages.

    Raises:
        InputError: The function raises it.
        RunInterruptedError: Likewise.
        RunError: The function raises any other error, or something in it ends the process.
    """
    reading, writing = os.pipe()
    words = [sys.executable, "-c", "from harness.common.watching import answer; answer()", str(writing), function]
    paths = os.pathsep.join(filter(None, sys.path))
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, pass_fds=(writing,), process_group=0, env={**os.environ, "PYTHONPATH": paths}
    ) as process:
        os.close(writing)
        assert process.stdin is not None
        with suppress(BrokenPipeError), process.stdin as given:
            given.write(pickle.dumps(arguments))
        while process.poll() is None:
            try:
                process.wait()
            except KeyboardInterrupt:
                process.send_signal(signal.SIGINT)
    return _read(reading, process.pid, process.returncode, named)


def answer() -> None:
    """Do the work of the process that ``survived`` starts: call, and tell what came of it."""
    end_with_parent()
    writing = int(sys.argv[1])
    _tell_of_exits(writing)
    told: tuple[Any, BaseException | None]
    try:
        arguments = pickle.load(sys.stdin.buffer)  # a tracker among them may be of a module of the working folder
        set_folder_aside()
        told = resolve_name(sys.argv[2])(*arguments), None
    except (InputError, RunInterruptedError, KeyboardInterrupt) as error:
        told = None, error
    except BaseException as error:  # whatever external code raises
        told = None, RunError(str(error))
    _tell(writing, told)


def _tell(writing: int, told: tuple[Any, BaseException | None]) -> None:
    """Tell through a pipe what came of the work; threads and the like that never end hold this process up for a while.

    What they print from here on goes to stderr: whoever reads stdout has the whole result.
    """
    with suppress(OSError):  # external code has closed it: the parent tells
        os.write(writing, pickle.dumps(told))
    flush(sys.stdout)
    with suppress(OSError):
        os.dup2(2, 1)
    end = threading.Timer(LONGEST_END_S, lambda: os._exit(RUN_FAILED))
    end.daemon = True
    end.start()


def _tell_of_exits(writing: int) -> None:
    """Let ``os._exit`` tell through a pipe which line of external code calls it in this process."""
    leave, owner = os._exit, os.getpid()

    def told(code: int) -> NoReturn:
        caller = sys._getframe(1)
        if os.getpid() == owner and not caller.f_globals.get("__name__", "").startswith(("harness.", "mmpf.")):
            place = f"{Path(caller.f_code.co_filename).name} line {caller.f_lineno}"
            os.write(writing, pickle.dumps((None, RunError(f"{place} ended the process by os._exit({code}); fix it"))))
        leave(code)

    os._exit = told  # type: ignore[assignment]


def _fork(handed_on: Sequence[int]) -> tuple[int, int, set[Any]]:
    """Return the child, 0 within it, this side's end of a pipe, and the mask to be: both hold some signals back."""
    sys.stdout.flush()
    sys.stderr.flush()
    reading, writing = os.pipe()
    owner, mask = os.getpid(), signal.pthread_sigmask(signal.SIG_BLOCK, handed_on) - set(CODES)
    child = os.fork()
    if child:
        os.close(writing)
        with suppress(OSError):
            os.setpgid(child, child)
        return child, reading, mask
    os.setpgid(0, 0)
    end_with_parent()
    if os.getppid() != owner:
        os._exit(RUN_FAILED)
    return 0, writing, mask


def _told(child: int, pipe: int, mask: set[Any], handed_on: Sequence[int], named: str) -> int:
    """Wait for a child, hand signals on to it, once each, and return what it told.

    Raises:
        RunError: It ended without a word.
    """

    def hand_on(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGSTOP if number == signal.SIGTSTP else number)
            if number == signal.SIGTSTP:
                os.kill(os.getpid(), signal.SIGSTOP)
                os.kill(child, signal.SIGCONT)

    for number in handed_on:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, hand_on)
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    return int(_read(pipe, child, os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), named))


def _read(pipe: int, child: int, status: int, named: str) -> Any:  # noqa: ANN401
    """Return what a child that has ended told, and end what it left behind.

    Raises:
        RunError: It told nothing.
    """
    # Forks that the code has left behind end with it.
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)
    os.set_blocking(pipe, False)
    try:
        if content := os.read(pipe, 1 << 16):
            found, failure = pickle.loads(content)
            if failure is not None:
                raise failure
            return found
    except BlockingIOError:
        pass
    finally:
        os.close(pipe)
    how = f"crashed ({signal.Signals(-status).name})" if status < 0 else f"ended with exit code {status}"
    raise RunError(f"{named}: the process that ran it {how} before it finished; fix it")
