"""Treats the system's SIGTERM like Ctrl-C, so that finished work is kept."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from harness.common import exit_codes

CODES = {signal.SIGINT: exit_codes.INTERRUPTED, signal.SIGTERM: exit_codes.TERMINATED, signal.SIGHUP: exit_codes.HANGUP}
_received: list[signal.Signals] = []


class _ToldToEndError(KeyboardInterrupt):
    """Raised by a signal; not by a plain ``KeyboardInterrupt``, which ends Python by SIGINT once it left ``exec``."""


@contextmanager
def ends_like_ctrl_c() -> Iterator[None]:
    """Let SIGTERM and SIGHUP too raise ``KeyboardInterrupt`` in the block; what is ignored (nohup) stays so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _received.clear()
    previous = {end: signal.getsignal(end) for end in CODES}
    own = [end for end, does in previous.items() if does in (signal.SIG_DFL, signal.default_int_handler)]
    for end in own:
        signal.signal(end, _interrupt)
    told, sys.unraisablehook = sys.unraisablehook, _again
    try:
        yield
    finally:
        sys.unraisablehook = told
        for end in own:
            if signal.getsignal(end) is _interrupt:
                signal.signal(end, previous[end])
        if own:
            _received.clear()


def told_to_end() -> bool:
    """Return whether a signal has arrived: libraries that it interrupts may raise another error or hide it."""
    return bool(_received)


def code_of_end() -> int:
    """Return the exit code of the signal that ended the command."""
    return CODES[_received[-1]] if _received else exit_codes.INTERRUPTED


@contextmanager
def signals_held(*, forgotten: bool = False) -> Iterator[None]:
    """Let the signals that end a program wait until what must not be half done is done, or forget those that come."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []

    def hold(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        came.append(number)

    previous = {end: signal.signal(end, signal.SIG_IGN if forgotten else hold) for end in CODES}
    try:
        yield
    finally:
        for end, handler in previous.items():
            signal.signal(end, handler)
        if came:
            signal.raise_signal(came[0])


def _again(ignored: "sys.UnraisableHookArgs") -> None:
    """Raise a signal once more that Python ignored, since it came while a finalizer or a callback was called."""
    if isinstance(ignored.exc_value, _ToldToEndError):
        threading.Timer(0.01, os.kill, (os.getpid(), _received[-1])).start()
    else:
        sys.__unraisablehook__(ignored)


def _interrupt(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
    _received.append(signal.Signals(number))
    raise _ToldToEndError


_masks: dict[int, set[int]] = {}


def _hold_at_fork() -> None:
    # Python forgets a signal that comes to a fork before it has set that up.
    _masks[threading.get_ident()] = signal.pthread_sigmask(signal.SIG_BLOCK, CODES)


def _free_after_fork() -> None:
    signal.pthread_sigmask(signal.SIG_SETMASK, _masks.pop(threading.get_ident()))


def _end_as_usual_in_fork() -> None:
    """Let a fork end by a signal without a traceback, for example a worker of a pool of external code."""
    for end in CODES:
        if signal.getsignal(end) is _interrupt:
            signal.signal(end, signal.SIG_DFL)
    _free_after_fork()


os.register_at_fork(before=_hold_at_fork, after_in_parent=_free_after_fork, after_in_child=_end_as_usual_in_fork)
