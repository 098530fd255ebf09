"""Looks up what users name in a registry; an error says which option gave the name."""

from collections.abc import Callable
from typing import TypeVar

from harness.common.errors import InputError
from harness.common.streams import streams_and_depth_kept
from mmpf.registry import Registry

T = TypeVar("T")


def named(registry: Registry[T], option: str, name: str) -> T:
    """Return the entry of a name that was given for an option."""
    with streams_and_depth_kept():
        problem = registry.problem(name)
    if problem:
        raise InputError(f"`{option}`{problem}")
    return registry[name]


def check_made(registry: Registry[T], option: str, name: str, thing: object) -> None:
    """Refuse what an entry made if it is something else."""
    fault = registry.fault(thing) if registry.fault is not None else ""
    if fault:
        raise InputError(f"`{option}` {name}: it returned {type(thing).__name__}, {fault}")


def without_method(*methods: str) -> Callable[[object], str]:
    """Return a check that a thing has one of some methods, of which the first is named with its arguments."""
    names = [method.partition("(")[0] for method in methods]

    def fault(thing: object) -> str:
        has_one = any(callable(getattr(thing, name, None)) for name in names)
        return "" if has_one else f"which has no method {methods[0]}"

    return fault
