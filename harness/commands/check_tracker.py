"""``check-tracker``: check that a tracker does what the tracker protocol requires."""

from __future__ import annotations

import json
from typing import Annotated, Any, TypedDict

import typer

from harness.common import exit_codes
from harness.common.streams import streams_and_depth_kept
from harness.config.layers import merged
from harness.config.options import Option
from harness.trackers.catalogue import build_tracker
from harness.trackers.conformance.checks import tracker_checks
from harness.trackers.conformance.requirements import TrackerCheckError


class Options(TypedDict):
    """The options of ``check-tracker``."""

    tracker: Annotated[
        str,
        Option(
            "Tracker by name, module:factory, or 'exec:COMMAND' for a program.",
            default=...,
            metavar="TRACKER",
            is_argument=True,
        ),
    ]
    settings: Annotated[
        list[str] | None,
        Option("An option of the tracker; repeatable.", flag="--set", metavar="tracker.options.KEY=VALUE"),
    ]
    json: Annotated[bool, Option("Print the checks and their results as JSON on stdout.", default=False)]


def command(options: Options) -> int:
    """Check a tracker on small scenes with known answers; print one line per check.

    Exit code 0: all checks pass. 3: at least one fails.

    Examples:
      python -m harness check-tracker exec:./my_tracker
      python -m harness check-tracker mine:Tracker --set tracker.options.gain=0.4
    """
    table: dict[str, Any] = merged(None, {}, options["settings"] or ())
    own = table.get("tracker", {}).get("options", {})
    findings: dict[str, str | None] = {}
    for check in tracker_checks():
        try:
            with streams_and_depth_kept():
                check(lambda setting, given: build_tracker(options["tracker"], setting, given), own)
            findings[check.name] = None
        except TrackerCheckError as finding:
            findings[check.name] = " ".join(str(finding).split())
        if not options["json"]:
            told = f"failed: {findings[check.name]}" if findings[check.name] else "ok"
            typer.echo(f"{check.name.replace('_', ' ')}: {told}")
    if options["json"]:
        typer.echo(json.dumps(findings, indent=1))
    return exit_codes.RUN_FAILED if any(findings.values()) else exit_codes.DONE
