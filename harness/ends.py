"""A process that is told to end by the system ends as by Ctrl-C: what was finished is kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from harness import exitcodes

CODES = {
    signal.SIGINT: exitcodes.INTERRUPTED,
    signal.SIGTERM: exitcodes.TERMINATED,
    signal.SIGHUP: exitcodes.HANGUP,
}
_last = [signal.SIGINT]


@contextmanager
def ends_like_ctrl_c() -> Iterator[None]:
    """Let SIGTERM and SIGHUP raise ``KeyboardInterrupt`` in the block; what is ignored, as under nohup, stays so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _last[0] = signal.SIGINT
    own = [end for end in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(end) is signal.SIG_DFL]
    for end in own:
        signal.signal(end, _interrupt)
    try:
        yield
    finally:
        for end in own:
            signal.signal(end, signal.SIG_DFL)


def code_of_end() -> int:
    """Return the exit code of the signal that ended the command."""
    return CODES[_last[0]]


def _interrupt(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
    _last[0] = signal.Signals(number)
    raise KeyboardInterrupt
