"""What all kernels share: the compiler's options, the processors they are compiled for, and where they are kept.

Where the processor has the level x86-64-v3 (Haswell, Zen and later), kernels are compiled for that level and nothing
above it. All such processors then compute the same bytes, and a package can bring its kernels compiled. numba has one
target for a process, so this holds for all that is compiled after the import. ``NUMBA_CPU_NAME`` or
``NUMBA_CPU_FEATURES`` choose another target.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, InTreeCacheLocator, NullCache
from numba.core.codegen import get_host_cpu_features

Function = TypeVar("Function", bound=Callable[..., object])

LEVEL = "x86-64-v3"
OF_LEVEL = "+avx,+avx2,+bmi,+bmi2,+cx16,+f16c,+fma,+lzcnt,+movbe,+popcnt,+sahf,+sse3,+sse4.1,+sse4.2,+ssse3,+xsave"
"""What a processor of that level has (x86-64 psABI, table 3.1), as LLVM names it."""
SHIPPED = "compiled"
"""Folder beside a module in which a package brings its kernels."""

config: Any = numba.config
host_features: Any = get_host_cpu_features
has_level = set(OF_LEVEL.split(",")) <= set(host_features().split(","))
if has_level and config.CPU_NAME is None and config.CPU_FEATURES is None:
    config.CPU_NAME, config.CPU_FEATURES = LEVEL, ""


class _BesideModule(InTreeCacheLocator):
    """Finds the kernels that a package brings; nothing is written there."""

    def get_cache_path(self) -> str:
        return str(Path(self._py_file).parent / SHIPPED)

    def ensure_cache_path(self) -> None:
        Path(self.get_cache_path()).stat()  # where there is no such folder, nobody looks for kernels in it


class _ShippedFiles(CompileResultCacheImpl):
    _locator_classes = [_BesideModule]  # noqa: RUF012


class _ShippedCache(FunctionCache):
    _impl_class = _ShippedFiles


@dataclass(frozen=True)
class _Caches:
    """numba's role of a cache: kernels that the package brings, else those that were compiled here."""

    shipped: Any
    own: Any

    @property
    def cache_path(self) -> object:
        return self.own.cache_path

    def load_overload(self, signature: object, context: object) -> object:
        found = self.shipped.load_overload(signature, context)
        return self.own.load_overload(signature, context) if found is None else found

    def save_overload(self, signature: object, compiled: object) -> None:
        self.own.save_overload(signature, compiled)


# No division is checked, since each is by what can't be zero or means infinity; nobody calls kernels from C.
_compiled = partial(numba.njit, nogil=True, error_model="numpy", no_cfunc_wrapper=True)


def kernel(**options: object) -> Callable[[Function], Function]:
    """Return a decorator that compiles a function; more of numba's options may be given."""

    def decorated(function: Function) -> Function:
        dispatcher: Any = _compiled(**options)(function)
        if dispatcher is not function:  # NUMBA_DISABLE_JIT leaves it as it is
            dispatcher._cache = _Caches(_cache(_ShippedCache, function), _cache(FunctionCache, function))
        return dispatcher  # type: ignore[no-any-return]

    return decorated


part_of_kernel = partial(_compiled, no_cpython_wrapper=True)
"""The same for a function that only kernels call: it becomes a part of their machine code and can't be called else."""


def _cache(kind: type[FunctionCache], function: Callable[..., object]) -> FunctionCache | NullCache:
    try:
        return kind(function)
    except RuntimeError:  # there is no folder that can be written to
        return NullCache()
