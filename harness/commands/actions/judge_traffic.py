"""Compares simulated with measured traffic, and writes and prints the result."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import typer

from harness.common.markdown import show_markdown
from harness.common.progress import progress_bar
from harness.config.lists import names, seed_values
from harness.lab.fidelity.comparison import FidelityRequest, compare_traffic
from harness.lab.fidelity.report import as_markdown, write_fidelity
from harness.truth.network.network import load_network


def judge_traffic(options: Mapping[str, Any]) -> None:
    """Run ``fidelity`` with the given options; raises ``InputError`` where they are wrong."""
    demand, out, quiet = options["demand"], options["out"], options["quiet"]
    network = load_network(options["net"] or "us101")
    request = FidelityRequest(
        demands=names(demand, "--demand", "us101-0805") if demand is not None else (),
        seeds=tuple(seed_values(options["seeds"])),
        duration_s=60.0 * options["minutes"],
        fields=options["fields"],
        recordings=tuple(options["recordings"] or ()),
        workers=options["workers"],
    )

    with progress_bar("fidelity", request.runs(network), quiet, before="fidelity: the first simulations") as advance:
        result = compare_traffic(network, request, advance)
    write_fidelity(result, out)
    if not quiet:
        show_markdown(as_markdown(result), on_stderr=True)
    if options["json"]:
        typer.echo(json.dumps(result.as_json(), indent=2))
    typer.echo(f"written to {out}", err=True)
