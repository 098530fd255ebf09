"""Registries of named things that load on demand: built-in ones and those of other packages."""

from __future__ import annotations

import ast
import difflib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")
SET_ASIDE: list[str] = []
"""Folders that join those of modules when the first of somebody's own is asked for, and not before."""


class UnknownNameError(KeyError):
    """A name that no entry of the registry has, or whose entry can't be had; its message says which and why."""

    def __str__(self) -> str:
        return str(self.args[0])


class PartMissingError(UnknownNameError):
    """An entry that needs a part of the package which is not installed; its message says which."""


@dataclass(frozen=True)
class Entry:
    """Where a named thing is; nothing of it is imported before it is asked for.

    Attributes:
        place: ``module:attribute``.
        about: One line about it.
        extra: Optional part of the package that it needs.
        needs: What that part installs, for people; empty for the name of the module that is missing.
    """

    place: str
    about: str = ""
    extra: str = ""
    needs: str = ""


@dataclass(frozen=True)
class Registry(Generic[T]):
    """Named things of one kind, for example the motion models.

    Beside those that come along and those that are registered there are those that installed packages declare as entry
    points; these are looked up where a name is neither, and never replace one that is. ``module:attribute`` is a name
    as well, for one that no package declares. All but those that are registered are imported when they are asked for.

    Attributes:
        kind: What the entries are, in the singular, for messages ("motion model").
        group: The group of entry points; without one, there are only those that come along or are registered.
        entries: Those that come along.
        unknown: What is said of an unknown ``name``, with the ``kind``, and the names ``known`` or ``in_order``.
        fault: Returns what is wrong with what an entry makes, in words; empty if nothing is.
    """

    kind: str
    group: str | None = None
    entries: Mapping[str, Entry] = field(default_factory=dict)
    unknown: str = "unknown {kind} {name!r}; known are: {known}"
    fault: Callable[[object], str] | None = None
    _registered: dict[str, T] = field(default_factory=dict)

    def register(self, name: str) -> Callable[[T], T]:
        """Return a decorator that files its argument under ``name``.

        Raises:
            ValueError: The name is taken.
        """

        def file_under_name(entry: T) -> T:
            if name in self.own:
                raise ValueError(f"a {self.kind} named {name!r} is registered already")
            self._registered[name] = entry
            return entry

        return file_under_name

    @property
    def own(self) -> tuple[str, ...]:
        """The names of those that come along, in their order, and of those that are registered."""
        return (*self.entries, *self._registered)

    def __getitem__(self, name: str) -> T:
        """Return the entry of that name.

        Raises:
            UnknownNameError: There is none, or it can't be had.
        """
        if name in self._registered:
            return self._registered[name]
        if name in self.entries:
            return self._own_entry(name)
        found = [point for point in entry_points_of(self.group) if point.name == name]
        if len(found) > 1:
            packages = " and ".join(sorted(_package(point) for point in found))
            raise UnknownNameError(f"the {self.kind} {name!r} is declared by {packages}; uninstall all but one")
        if found:
            return self._loaded(found[0])
        if ":" in name and self.group is not None:
            module = name.partition(":")[0]
            if module.partition(".")[0] in sys.stdlib_module_names:
                raise UnknownNameError(f"{name} is part of Python itself and no {self.kind}")
            if module.endswith(".py") or not all(map(str.isidentifier, module.split("."))):
                raise UnknownNameError(f"{module} is no module; write module:name, without a folder or .py")
            from importlib.metadata import EntryPoint  # noqa: PLC0415

            return self._loaded(EntryPoint(name, name, self.group))
        known, in_order = ", ".join(self), ", ".join(self.names())
        told = self.unknown.format(kind=self.kind, name=name, known=known, in_order=in_order)
        raise UnknownNameError(told + _did_you_mean(name, self.names()))

    def problem(self, name: str) -> str:
        """Return in words why a name has no entry to be had, to follow what was named; empty if it has one."""
        try:
            self[name]
        except PartMissingError as error:
            return f": {error}"
        except UnknownNameError as error:
            return f" {name}: {error}"
        return ""

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self.names()))

    def names(self) -> tuple[str, ...]:
        """Return all names: those that come along in their order, and after them those of installed packages."""
        return tuple(dict.fromkeys((*self.own, *sorted(point.name for point in entry_points_of(self.group)))))

    def is_outside(self, name: str) -> bool:
        """Return whether a name is a place, ``module:attribute``, or declared by an installed package."""
        return name not in self.own and (":" in name or name in self.names())

    def in_order(self) -> dict[str, T]:
        """Return those that come along or are registered, by name."""
        return {name: self[name] for name in self.own}

    def _own_entry(self, name: str) -> T:
        entry = self.entries[name]
        module, _, attribute = entry.place.partition(":")
        try:
            return cast("T", getattr(import_module(module), attribute))
        except ModuleNotFoundError as error:
            missing = error.name or ""
            if not entry.extra or missing.partition(".")[0] in (module.partition(".")[0], "mmpf"):
                raise
            what = entry.needs or missing
            raise PartMissingError(
                f"{name} needs {what}, which is not installed: pip install -c constraints.txt '.[{entry.extra}]'"
            ) from None

    def _loaded(self, point: EntryPoint) -> T:
        named = f"the {self.kind} {point.value!r}" + (f" of {_package(point)}" if point.dist else "")
        entry = imported(point.load, named)
        if not callable(entry):
            raise UnknownNameError(f"{named} is no class or function, but of type {type(entry).__name__}")
        return cast("T", entry)


def imported(load: Callable[[], T], named: str) -> T:
    """Return what a function loads of somebody's code.

    Raises:
        UnknownNameError: It can't be imported; the message says what is ``named``, and why.
    """
    sys.path[:0], SET_ASIDE[:] = SET_ASIDE, []
    try:
        return load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        hint = "; is it on PYTHONPATH or installed?" if isinstance(error, ModuleNotFoundError) else ""
        if isinstance(error, AttributeError) and error.name is not None:
            hint = _did_you_mean(error.name, dir(error.obj))
        raise UnknownNameError(f"can't import {named} ({type(error).__name__}: {error}){hint}") from None


@cache
def entry_points_of(group: str | None) -> Sequence[EntryPoint]:
    """Return what installed packages declare in a group, read once a process; ``cache_clear`` has it read anew."""
    if group is None:
        return ()
    from importlib.metadata import entry_points  # noqa: PLC0415  (slow, and seldom needed)

    return entry_points(group=group)


def _did_you_mean(name: str, known: Sequence[str]) -> str:
    """Return the question for a name that was nearly right; empty where none is near."""
    near = difflib.get_close_matches(name, known)
    return f"; did you mean {' or '.join(near)}?" if near else ""


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else "a package"


def names_of_stub(module: str, file: str) -> tuple[Callable[[str], Any], list[str]]:
    """Return a module's ``__getattr__`` and ``__all__``: the names of the stub beside it, imported on first use.

    As in SPEC 1 of Scientific Python: type checkers read the stub, and what is not used is not imported.

    Args:
        module: The module's name.
        file: Its ``__file__``; the stub, ``.pyi``, has nothing but ``from module import name as name``.
    """
    stub = ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8"))
    lines = [line for line in stub.body if isinstance(line, ast.ImportFrom)]
    homes = {name.asname or name.name: (str(line.module), name.name) for line in lines for name in line.names}

    def named(name: str) -> Any:  # noqa: ANN401  the type is the name's own
        if name not in homes:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home, own = homes[name]
        return getattr(import_module(home), own)

    return named, sorted(homes)
