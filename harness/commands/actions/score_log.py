"""Scores a log as the options of ``score`` say, and tells the result."""

from typing import Any

import typer

from harness.commands.from_options import typed
from harness.common.numbers import as_json as text_of
from harness.common.progress import working
from harness.common.streams import to_stderr
from harness.report.folder_page import write_page
from harness.report.summary import print_summary
from harness.running.logged import score_logs


def score_log(options: Any) -> None:  # noqa: ANN401  the command's own table
    """Score the log, print what is missing and the scores, and write its page."""
    as_json, quiet, out, force = options["json"], options["quiet"], options["out"], options["force"]
    with working("scoring", quiet):
        folder, metrics, report, is_whole = score_logs(options, out, force, typed(), write_page)
    if not (is_whole and quiet):
        to_stderr(report)
    if not quiet:
        print_summary(metrics, folder, is_log=True)
    if as_json:
        typer.echo(text_of(metrics), nl=False)
