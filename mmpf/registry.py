"""A name-to-factory table that refuses duplicates, finds what packages add, and answers a wrong name with the names."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")


class UnknownNameError(KeyError):
    """A name that no entry of the registry has, or whose entry can't be had; its message says which and why."""

    def __str__(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True)
class Registry(Generic[T]):
    """Named things of one kind, for example the motion models.

    Beside those that register themselves there are those that installed packages declare as entry points; these are
    looked up where a name is not registered, never replace one that is, and are imported when they are asked for.
    ``module:attribute`` is a name as well, for one that no package declares.

    Attributes:
        kind: What the entries are, in the singular, for messages ("motion model").
        group: The group of entry points; without one, entries are registered and nothing else.
    """

    kind: str
    group: str | None = None
    _entries: dict[str, T] = field(default_factory=dict)

    def register(self, name: str) -> Callable[[T], T]:
        """Return a decorator that files its argument under ``name``.

        Raises:
            ValueError: The name is taken.
        """

        def file_under_name(entry: T) -> T:
            if name in self._entries:
                raise ValueError(f"a {self.kind} named {name!r} is registered already")
            self._entries[name] = entry
            return entry

        return file_under_name

    def __getitem__(self, name: str) -> T:
        """Return the entry of that name.

        Raises:
            UnknownNameError: There is none.
        """
        if name in self._entries:
            return self._entries[name]
        declared = [point for point in self._declared() if point.name == name]
        if len(declared) > 1:
            packages = " and ".join(sorted(_package(point) for point in declared))
            raise UnknownNameError(f"the {self.kind} {name!r} is declared by {packages}; uninstall all but one")
        if declared:
            return self._loaded(declared[0], f"of {_package(declared[0])}")
        if ":" in name and self.group is not None:
            from importlib.metadata import EntryPoint  # noqa: PLC0415

            return self._loaded(EntryPoint(name, name, self.group), "is it on PYTHONPATH or installed?")
        raise UnknownNameError(f"unknown {self.kind} {name!r}; known are: {', '.join(self)}")

    def __iter__(self) -> Iterator[str]:
        return iter(sorted({*self._entries, *(point.name for point in self._declared())}))

    def in_order(self) -> dict[str, T]:
        """Return the entries by name in the order of their registration."""
        return dict(self._entries)

    def _declared(self) -> Iterable[EntryPoint]:
        if self.group is None:
            return ()
        from importlib.metadata import entry_points  # noqa: PLC0415  (slow, and seldom needed)

        return entry_points(group=self.group)

    def _loaded(self, point: EntryPoint, remark: str) -> T:
        try:
            entry = point.load()
        except Exception as error:
            problem = f"{type(error).__name__}: {error}"
            raise UnknownNameError(f"can't import the {self.kind} {point.value!r} ({problem}), {remark}") from None
        if not callable(entry):
            raise UnknownNameError(f"the {self.kind} {point.value!r} is not callable, {remark}")
        return cast("T", entry)


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
