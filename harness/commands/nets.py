"""``nets``: which road networks and demands there are."""

import json
from dataclasses import asdict
from typing import TypedDict

import typer

from harness.config import options as shared


class Options(TypedDict):
    """The options of ``nets``."""

    json: shared.Json


def command(options: Options) -> None:
    """List the bundled road networks and their named demands.

    To use your own network, give its folder or .sumocfg file to --net.

    Examples:
      python -m harness nets
      python -m harness run --net us101 --demand us101-0805
    """
    from harness.truth.network.network import available_networks  # noqa: PLC0415

    networks = available_networks()
    if options["json"]:
        typer.echo(json.dumps([asdict(network) for network in networks], indent=2))
        return

    from harness.report.summary import print_networks  # noqa: PLC0415

    print_networks(networks)
