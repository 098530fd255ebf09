"""Looks up what users name in a registry; an error says which option gave the name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from harness.common.errors import InputError
from harness.common.streams import streams_and_depth_kept

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class Catalogue(Protocol[T_co]):
    """A registry, as ``mmpf.registry.Registry`` is one."""

    @property
    def fault(self) -> Callable[[object], str] | None:
        """Return what is wrong with a thing that an entry made; None where anything is right."""

    def __getitem__(self, name: str) -> T_co:
        """Return the entry of a name."""

    def problem(self, name: str) -> str:
        """Return a sentence on why a name has no usable entry; empty if it has one."""


def named(registry: Catalogue[T], option: str, name: str) -> T:
    """Return the entry of a name.

    Args:
        option: The option that the name was given for.

    Raises:
        InputError: There is none of that name, or it can't be had.
    """
    with streams_and_depth_kept():
        problem = registry.problem(name)
    if problem:
        raise InputError(f"`{option}`{problem}")
    return registry[name]


def check_made(registry: Catalogue[T], option: str, name: str, thing: object) -> None:
    """Refuse what an entry made if it is something else.

    Raises:
        InputError: It is.
    """
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
