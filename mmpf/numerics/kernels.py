"""How kernels are compiled: one set of options, so that what several of them use is compiled for all at once."""

from __future__ import annotations

from functools import partial
from typing import Any

import numba
from llvmlite import binding

LEVEL = "x86-64-v3"
_OF_LEVEL = ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave")


def _compile_for_level() -> None:
    """Compile for a level of processors, where this one has it, so that all of that level give equal bytes.

    It counts for all that numba compiles in this process from here on; who sets ``NUMBA_CPU_NAME`` has their way.
    """
    config: Any = numba.config
    has = binding.get_host_cpu_features()
    if config.CPU_NAME is None and all(has.get(feature, False) for feature in _OF_LEVEL):
        config.CPU_NAME, config.CPU_FEATURES = LEVEL, ",".join(f"+{feature}" for feature in _OF_LEVEL)


_compile_for_level()
# No division is checked, since each is by what can't be zero or means infinity; nobody calls kernels from C.
kernel = partial(numba.njit, cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)
"""Decorator that compiles a function; more of numba's options may be given."""
of_each: Any = partial(numba.vectorize, cache=True)
"""Decorator that makes a function of numbers one of arrays, as NumPy's are."""
