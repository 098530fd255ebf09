"""Compiled loops on several processor cores: each takes its share of the particles, so that results do not change."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

from numba import config

MOST_THREADS = 4
LEAST_SHARE = 4096


def in_shares(work: Callable[[int, int], None], size: int, cost: float = 1.0, block: int = 1) -> None:
    """Call ``work(begin, end)`` for ranges that cover ``0 ... size``, on several cores where that pays.

    There are as many shares as numba has threads (``NUMBA_NUM_THREADS``, by default the processor's cores), at most
    four. The work on a range must depend on nothing outside it, and let go of the interpreter's lock.

    Args:
        work: What is to be done.
        size: End of the last range.
        cost: Work per element in relation to a simple loop; it pays to share out fewer elements if they cost more.
        block: Shares begin at multiples of this: loops that work in blocks then meet the same blocks however many
            shares there are.
    """
    shares = min(int(vars(config)["NUMBA_NUM_THREADS"]), MOST_THREADS, int(size * cost) // LEAST_SHARE)
    if shares <= 1:
        work(0, size)
        return
    bounds = [size * share // shares // block * block for share in range(shares)] + [size]
    others = [_pool(os.getpid()).submit(work, bounds[k], bounds[k + 1]) for k in range(1, shares)]
    work(bounds[0], bounds[1])
    for other in others:
        other.result()


@cache
def _pool(process: int) -> ThreadPoolExecutor:  # noqa: ARG001  a forked process has none of its parent's threads
    return ThreadPoolExecutor(MOST_THREADS - 1, thread_name_prefix="mmpf")
