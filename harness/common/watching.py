"""Runs a command that loads external code in a child process, and reports in one line if that code ends it."""

from __future__ import annotations

import ctypes
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import FrameType

from harness.common.exit_codes import RUN_FAILED
from harness.common.isolation import DIES_WITH_PARENT
from harness.common.signals import CODES

NAMES_CODE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")


def code_named(arguments: Sequence[str]) -> list[str]:
    """Return what among the words of a command may be ``module:attribute``, alone, in a list or behind ``KEY=``."""
    words = (word.rpartition("=")[2].strip("\"'[] ") for text in arguments for word in text.split(","))
    return [word for word in words if NAMES_CODE.fullmatch(word)]


def watched(arguments: Sequence[str], work: Callable[[], int]) -> int:
    """Do the work of a command and return its exit code; in a child, in its own group, if the arguments name code.

    Signals that end or stop this process are handed on to the child, once each.
    """
    named = code_named(arguments)
    if not named:
        return work()
    reading, writing = os.pipe()
    owner, handed_on = os.getpid(), (*CODES, signal.SIGTSTP)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, handed_on)
    child = os.fork()
    if not child:
        os.setpgid(0, 0)
        ctypes.CDLL(None).prctl(DIES_WITH_PARENT, signal.SIGKILL)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        code = work() if os.getppid() == owner else RUN_FAILED
        os.write(writing, bytes([code]))
        return code
    os.close(writing)
    with suppress(OSError):
        os.setpgid(child, child)

    def hand_on(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGSTOP if number == signal.SIGTSTP else number)
            if number == signal.SIGTSTP:
                os.kill(owner, signal.SIGSTOP)
                os.kill(child, signal.SIGCONT)

    for number in handed_on:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, hand_on)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    # Forks that the code has left behind end with it.
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)
    os.set_blocking(reading, False)
    with suppress(BlockingIOError):
        if told := os.read(reading, 1):
            return told[0]
    how = f"crashed it ({signal.Signals(-status).name})" if status < 0 else f"ended it with exit code {status}"
    sys.stderr.write(f"error: {', '.join(named)}: something in it {how} before the command was done; fix it\n")
    return RUN_FAILED
