"""``reference``: makes the reference tables, each by one command from a clean tree."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypedDict

from harness.config import options as shared
from harness.config.options import Option


class Options(TypedDict):
    """The options of ``reference``."""

    name: Annotated[
        str | None, Option("Name of a table, or all; without it, list all tables.", metavar="NAME", is_argument=True)
    ]
    check: Annotated[
        bool,
        Option(
            "Compute the table in another folder and list the differences from the committed one; exit code 1 if there "
            "are any. On another CPU type only traffic and detections are compared. Without NAME: list the tables that "
            "older code made.",
            default=False,
        ),
    ]
    out: Annotated[
        Path | None,
        Option("Trial: write to this folder and keep the committed table; uncommitted changes are allowed."),
    ]
    workers: shared.Workers
    quiet: shared.Quiet


def command(options: Options) -> int:
    """Compute the reference table results/reference/NAME from a clean checkout.

    results/reference/tables.toml lists the tables, each with its command.
    Finished runs are kept in results/making, so an interrupted table can
    continue, and new seeds or trackers add only their own runs, unless the
    sources changed.

    Examples:
      python -m harness reference
      python -m harness reference trackers --workers 2
      python -m harness reference small --check
    """
    from harness.commands.actions.make_or_check import make_or_check  # noqa: PLC0415

    return make_or_check(options)
