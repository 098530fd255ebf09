"""``reference``: makes the reference tables, each by one command from a clean tree."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypedDict

from harness.config import options as shared
from harness.config.options import Option


class Options(TypedDict):
    """The options of ``reference``."""

    name: Annotated[str | None, Option("Which, or all; without it, all are listed.", metavar="NAME", is_argument=True)]
    check: Annotated[
        bool,
        Option(
            "Make it aside and say where it differs from the committed one: exit code 1. On another kind of processor "
            "only traffic and detections are compared. Without a name: say which tables older code made.",
            default=False,
        ),
    ]
    out: Annotated[Path | None, Option("A trial: write here, and leave the committed one; the tree need not be clean.")]
    workers: shared.Workers
    quiet: shared.Quiet


def command(options: Options) -> int:
    """Make a reference table: results/reference/NAME, from a clean tree.

    results/reference/tables.toml lists them, each with the command that it
    stands for. Runs are kept in results/making: what was interrupted is taken
    up again, and a table to which seeds or trackers are added makes only
    these, unless the sources changed.

    Examples:
      python -m harness reference
      python -m harness reference trackers --workers 2
      python -m harness reference small --check
    """
    from harness.commands.actions.make_or_check import make_or_check  # noqa: PLC0415

    return make_or_check(options)
