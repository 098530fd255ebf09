"""What users name, looked up in a registry: whatever is wrong with it is told with the option that named it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from harness.common.errors import InputError
from mmpf.registry import PartMissingError, Registry, UnknownNameError

T = TypeVar("T")


def named(registry: Registry[T], option: str, name: str) -> T:
    """Return the entry of a name.

    Args:
        registry: Where it is looked up.
        option: The option that the name was given for.
        name: The name.

    Raises:
        InputError: There is none of that name, or it can't be had.
    """
    try:
        return registry[name]
    except PartMissingError as error:
        raise InputError(f"`{option}`: {error}") from None
    except UnknownNameError as error:
        raise InputError(f"`{option}` {name}: {error}") from None


def check_made(registry: Registry[T], option: str, name: str, thing: object) -> None:
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
