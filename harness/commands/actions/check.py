"""Checks a tracker as ``check-tracker`` does, and prints what each check found."""

import json
from collections.abc import Sequence

import typer

from harness.common import exit_codes
from harness.common.streams import streams_and_depth_kept
from harness.config.layers import merged
from harness.trackers.catalogue import build_tracker
from harness.trackers.conformance.checks import tracker_checks
from harness.trackers.conformance.requirements import TrackerCheckError


def check_one(tracker: str, settings: Sequence[str], as_json: bool) -> int:
    """Check a tracker by name, with settings of its own, and return the exit code."""
    own = merged(None, {}, settings).get("tracker", {}).get("options", {})
    findings: dict[str, str | None] = {}
    for check in tracker_checks():
        try:
            with streams_and_depth_kept():
                check(lambda setting, given: build_tracker(tracker, setting, given), own)
            findings[check.name] = None
        except TrackerCheckError as finding:
            findings[check.name] = " ".join(str(finding).split())
        if not as_json:
            told = f"failed: {findings[check.name]}" if findings[check.name] else "ok"
            typer.echo(f"{check.name.replace('_', ' ')}: {told}")
    if as_json:
        typer.echo(json.dumps(findings, indent=1))
    return exit_codes.RUN_FAILED if any(findings.values()) else exit_codes.DONE
