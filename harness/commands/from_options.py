"""Makes a typer command from a function and one table of options."""

import inspect
import json
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from operator import getitem
from pathlib import Path
from typing import Annotated, Any, cast, get_type_hints

import typer

from harness.common.errors import InputError, RunError
from harness.config.options import Declared, options_of
from harness.truth.network.names import check_network

Outcome = int | None


def typer_command(command: Callable[..., Outcome]) -> Callable[..., Outcome]:
    """Return what typer takes for a command of a table of options."""

    def called(**values: object) -> Outcome:
        # Training may take a list of networks.
        if (net := values.get("net")) is not None and "," not in str(net):
            check_network(str(net))
        return command(values) if values else command()

    parameters = [_parameter(name, entry) for name, entry in _entries(command).items()]
    called.__doc__ = command.__doc__
    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return called


def with_values(command: Callable[..., Outcome], arguments: Sequence[str]) -> list[str]:
    """Return what was typed, with a value after each option that may be typed without one.

    Raises:
        InputError: After an option that needs a value stands another option, or after ``--json`` a file.
    """
    named = {f"--{name.replace('_', '-')}": entry for name, entry in _entries(command).items()}
    alone = {name: entry.option.alone for name, entry in named.items() if entry.option.alone}
    valued = {name for name, entry in named.items() if entry.types[0] is not bool} - alone.keys()
    completed: list[str] = []
    for word, after in zip(arguments, [*arguments[1:], "--"], strict=True):
        if word in valued and after in named:
            raise InputError(f"{word}: needs a value, not {after}; --help has options and examples")
        file = after if word == "--json" else word.partition("--json=")[2]
        if file.endswith(".json"):
            raise InputError(f"--json: takes no file, it prints on stdout; write --json > {file}")
        completed.append(word)
        if word in alone and after.startswith("-"):
            completed.append(str(alone[word]))
    return completed


def typed() -> str:
    """Return the command of this process, as it is typed."""
    by_name = Path(sys.argv[0]).name == "mmpf-harness"
    return shlex.join([*(("mmpf-harness",) if by_name else ("python", "-m", "harness")), *sys.argv[1:]])


def tell_end(summary: Mapping[str, Any], failures: Sequence[str], folder: Path, runs: str, as_json: bool) -> None:
    """Print the summary of runs that ended as JSON, if asked to.

    Raises:
        RunError: Some failed.
    """
    if as_json:
        typer.echo(json.dumps(summary, indent=2))
    if failures:
        told = f"{len(failures)} of {summary['runs']} {runs} failed, the first: {failures[0]}"
        raise RunError(f"{told}; all rows are in {folder}")


def _entries(command: Callable[..., Outcome]) -> dict[str, Declared]:
    return options_of(get_type_hints(command).get("options", object))


def _parameter(name: str, entry: Declared) -> inspect.Parameter:
    option, kind = entry.option, entry.types[0]
    reader = {"parser": _reader(kind, option.least, option.most)} if kind in (int, float) else {}
    shared: dict[str, Any] = reader | {
        "help": option.help,
        # A flag takes no value, so none is shown.
        "metavar": "" if kind is bool else option.metavar,
        "rich_help_panel": option.panel,
        "min": option.least,
        "max": option.most,
    }
    if option.is_argument:
        info = typer.Argument(**shared)
    elif kind is bool or option.flag is not None:
        info = typer.Option(option.flag or f"--{name.replace('_', '-')}", **shared)
    else:
        info = typer.Option(**shared)
    default = inspect.Parameter.empty if option.default is ... else option.default
    annotation = getitem(Annotated, (kind if option.default is not None else kind | None, info))
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _reader(kind: type, least: float | None, most: float | None) -> Callable[[object], object]:
    """Return what reads a number as typer does, but neither 1_0 for 10 nor 1.0 for a whole number."""
    from pydantic import Field, TypeAdapter  # noqa: PLC0415  (the overview does without)
    from pydantic_core import PydanticCustomError  # noqa: PLC0415

    bounds = Field(ge=least, le=most, allow_inf_nan=False) if kind is float else Field(ge=least, le=most)
    known: TypeAdapter[Any] = TypeAdapter(cast("Any", getitem(Annotated, (kind, bounds))))

    def read(given: object) -> object:
        if isinstance(given, str) and ("_" in given or (kind is int and "." in given)):
            raise PydanticCustomError("number", "{given} is not a valid number", {"given": given})
        return known.validate_python(given)

    return read
