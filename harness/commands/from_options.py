"""Makes a command of typer's kind from a function of one table of options."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from operator import getitem
from typing import Annotated, Any, get_type_hints

import typer

from harness.config.options import Declared, declared

Outcome = int | None


def typer_command(command: Callable[..., Outcome]) -> Callable[..., Outcome]:
    """Return what typer takes for a command.

    Args:
        command: Takes ``options``, a table of options (see ``harness.config.options``), and may return an exit code.
            A function in typer's own manner is returned as it is.
    """
    table = get_type_hints(command).get("options")
    if table is None:
        return command

    def called(**values: object) -> Outcome:
        return command(values)

    parameters = [_parameter(name, entry) for name, entry in declared(table).items()]
    called.__doc__ = command.__doc__
    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return called


def _parameter(name: str, entry: Declared) -> inspect.Parameter:
    option, kind = entry.option, entry.types[0]
    shared: dict[str, Any] = {
        "help": option.help,
        "metavar": option.metavar,
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
