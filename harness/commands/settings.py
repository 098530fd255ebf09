"""``settings``: list all settings and their meanings."""

import json
from dataclasses import asdict
from typing import Annotated, TypedDict

import typer

from harness.config.options import Option


class Options(TypedDict):
    """The options of ``settings``."""

    word: Annotated[
        str,
        Option(
            "Show only settings whose key or kind contains this word.", default="", metavar="WORD", is_argument=True
        ),
    ]
    json: Annotated[bool, Option("Print the settings as JSON on stdout.", default=False)]


def command(options: Options) -> None:
    """List every setting with its default, unit and meaning, and all named choices.

    Settings of the run, the traffic, the sensor profiles and all trackers are
    listed by their key in config.toml (also for --set), followed by the names
    of networks, profiles, trackers and models.

    Examples:
      python -m harness settings
      python -m harness settings association
      python -m harness run --set tracker.options.joint.association.gate_std=4
    """
    from harness.commands.settings_table import all_settings, print_settings  # noqa: PLC0415

    rows = all_settings(options["word"])
    if options["json"]:
        typer.echo(json.dumps([asdict(row) for row in rows], indent=2, ensure_ascii=False, default=str))
    else:
        print_settings(rows)
