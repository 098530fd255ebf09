"""A machine that has other work: processes that do nothing but spin."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

# Ends by itself when its standard input is closed, so that none outlives a measurement that was killed.
SPINNING = """
import select, sys
while not select.select([sys.stdin], [], [], 0)[0]:
    for _ in range(1_000_000):
        pass
"""


@contextmanager
def busy_machine(count: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Let so many processes spin while the block runs; yields them."""
    processes = []
    with ExitStack() as stack:
        for _ in range(count):
            spinning = stack.enter_context(subprocess.Popen([sys.executable, "-c", SPINNING], stdin=subprocess.PIPE))
            stack.callback(spinning.kill)
            processes.append(spinning)
        yield processes
