"""The compiler options that all kernels share."""

from __future__ import annotations

from functools import partial

import numba

# No division is checked, since each is by what can't be zero or means infinity; nobody calls kernels from C.
kernel = partial(numba.njit, cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)
"""Decorator that compiles a function; more of numba's options may be given."""
part_of_kernel = partial(kernel, cache=False, no_cpython_wrapper=True)
"""The same for a function that only kernels call: it becomes a part of their machine code and can't be called else."""
