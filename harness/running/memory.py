"""Makes the process reuse the memory of freed arrays."""

from __future__ import annotations

import ctypes
import sys

TRIM_THRESHOLD, TOP_PAD, MMAP_THRESHOLD = -1, -2, -3
LARGEST_ALLOWED_BYTES = 32 * 2**20
NEVER_BYTES = 2**31 - 1
PAD_BYTES = 64 * 2**20


def keep_freed_memory() -> None:
    """Tell glibc's allocator to keep freed memory and to serve large arrays from it.

    Each step of a tracker lets go of arrays as large as the next step asks for. Handed back to the system, they cost a
    page fault for every 4 KiB when they come back: about a tenth of a step. Other allocators are left as they are.
    """
    if sys.platform != "linux":
        return
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is None:
        return
    set_option(MMAP_THRESHOLD, LARGEST_ALLOWED_BYTES)
    set_option(TRIM_THRESHOLD, NEVER_BYTES)
    set_option(TOP_PAD, PAD_BYTES)
