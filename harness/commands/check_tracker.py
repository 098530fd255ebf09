"""``check-tracker``: check that a tracker does what the tracker protocol requires."""

from typing import Annotated, TypedDict

from harness.config.options import Option


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
    from harness.commands.actions.check import check_one  # noqa: PLC0415

    return check_one(options["tracker"], options["settings"] or (), options["json"])
