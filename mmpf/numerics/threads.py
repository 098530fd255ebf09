"""The number of threads that share the particles; results do not depend on it."""

import os
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

VARIABLE = "MMPF_THREADS"
MOST_THREADS = 4
LEAST_SHARE = 4096


def in_shares(work: Callable[[int, int], None], size: int, cost: float = 1.0, block: int = 1) -> None:
    """Call ``work(begin, end)`` for ranges that cover ``0 ... size``, on several cores if that is faster.

    There are at most ``threads()`` shares. The work on a range must depend on nothing outside it, and let go of the
    interpreter's lock.

    Args:
        work: What is to be done.
        size: End of the last range.
        cost: Work per element in relation to a simple loop; it pays to share out fewer elements if they cost more.
        block: Shares begin at multiples of this: loops that work in blocks then meet the same blocks however many
            shares there are.
    """
    worthwhile = int(size * cost) // LEAST_SHARE
    shares = 1 if worthwhile < 2 else min(threads(), worthwhile)
    if shares == 1:
        work(0, size)
        return
    bounds = [size * share // shares // block * block for share in range(shares)] + [size]
    others = [_pool(os.getpid()).submit(work, bounds[k], bounds[k + 1]) for k in range(1, shares)]
    work(bounds[0], bounds[1])
    for other in others:
        other.result()


def threads() -> int:
    """Return the number of threads in the filter's own loops: the variable ``MMPF_THREADS``, 1 to 4, by default 1.

    A second one makes a step some per cent faster on an idle machine and slower on a busy one.
    """
    text = os.environ.get(VARIABLE, "1")
    if not text.isdecimal() or int(text) < 1:
        warnings.warn(f"{VARIABLE}={text} is not a number from 1 to {MOST_THREADS}; one thread is used", stacklevel=2)
        return 1
    return min(int(text), MOST_THREADS)


@cache
def _pool(process: int) -> ThreadPoolExecutor:  # noqa: ARG001  a forked process has none of its parent's threads
    return ThreadPoolExecutor(MOST_THREADS - 1, thread_name_prefix="mmpf")
