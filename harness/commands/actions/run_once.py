"""Does what ``run`` does, and tells the result."""

from typing import Any

import typer

from harness.api import make_run
from harness.commands.from_options import typed
from harness.common.numbers import as_json as text_of
from harness.common.streams import streams_and_depth_kept


def run_once(options: Any) -> None:  # noqa: ANN401  the command's own table
    """Make the run, and print its scores."""
    as_json, quiet = options.pop("json"), options.pop("quiet")
    with streams_and_depth_kept():  # libraries, SUMO's C++ among them, print on stdout
        finished = make_run(options, typed(), quiet)
    if not quiet:
        from harness.report.summary import print_summary  # noqa: PLC0415  slow, and not for what is refused

        print_summary(finished.metrics, finished.folder)
    if as_json:
        typer.echo(text_of(finished.metrics), nl=False)
