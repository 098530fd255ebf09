"""The command line: its commands, and how errors become one line and an exit code.

A command's module is imported only when that command is called, so ``--help`` answers at once. To add a command, write
``harness/commands/<name>.py`` with a function ``command(options)`` of one table of options (see
``harness.config.options``) and add one line to ``PANELS``. The function may return an exit code. Its docstring is its
help: lines of at most 78 characters, examples indented by two under a line "Examples:".
"""

import os
import re
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import typer
from typer.core import TyperGroup, TyperOption
from typer.exceptions import TyperException
from typer.main import get_group

from harness.commands.from_options import typer_command, with_values
from harness.common import exit_codes
from harness.common.error_text import in_words
from harness.common.errors import InputError, RunError, RunInterruptedError
from harness.common.files import NO_ROOM
from harness.common.signals import code_of_end, ends_like_ctrl_c, told_to_end
from harness.common.streams import HERE
from mmpf.registry import Entry, Registry, UnknownNameError

AS_TYPED = (InputError, UnknownNameError, RunError, RunInterruptedError)
"""Errors whose messages name parameters, as Python spells them."""
TRACEBACK = "HARNESS_TRACEBACK"
LONGEST_LINE = 1200

# What the overview tells of each command, under a heading.
PANELS = {
    "Run and look": {
        "run": "Simulate traffic or replay a recording, track, score; write tables and a page.",
        "nets": "List the bundled road networks and their named demands.",
        "settings": "List every setting: default, unit and meaning.",
        "score": "Score the log of a tracker that ran elsewhere.",
        "report": "Write the page of a run again, or its figures.",
        "export": "Write a run in another program's format.",
    },
    "Compare": {
        "compare": "Decide whether B is worse than A: worse, no worse or undecided.",
        "stress": "Run many densities, trackers and seeds.",
        "drive": "Let the ego drive on a tracker's output; count collisions and conflicts.",
        "study": "Compare motion models by situation, and repeat the paper's cases.",
        "bench": "Measure the computing time of trackers.",
        "check-tracker": "Check that your own tracker (Python or a program) meets the tracker interface.",
    },
    "Models and traffic": {
        "train": "Fit motion models to simulated traffic.",
        "fidelity": "Compare the simulated traffic with measured traffic.",
        "calibrate": "Fit the simulated traffic to recorded traffic.",
    },
}
COMMANDS: Registry[Callable[..., int | None]] = Registry(
    "command",
    entries={
        name: Entry(f"harness.commands.{name.replace('-', '_')}:command", about)
        for panel in PANELS.values()
        for name, about in panel.items()
    },
)

OVERVIEW = """Evaluate multi-vehicle tracking through occlusion: traffic, a sensor, a tracker, scores.

Start here:
  python -m harness run --net us101

Then compare with another tracker on the same detections:
  python -m harness run --density 45 --out results/a
  python -m harness run --replay results/a --tracker pmbm --out results/b
  python -m harness compare results/a results/b
"""


def run_command_line(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code, one of ``harness.common.exit_codes.MEANINGS``."""
    called = next((word for word in arguments if not word.startswith("-")), None)
    if (checkout := other_checkout(Path(os.readlink(HERE)), Path(__file__).parents[2])) is not None:
        line = (
            f"warning: this runs the copy in {Path(__file__).parents[2]}, not the checkout {checkout} that you stand in"
        )
        print(f"{line}; pip install -e {checkout} to run that", file=sys.stderr)  # noqa: T201
    group = get_group(application(called))
    for command in filter(None, (group, group.commands.get(called or ""))):
        if (asked := command.get_help_option(typer.Context(command))) is not None:
            asked.metavar = ""  # a flag takes no value
    with ends_like_ctrl_c():
        return _outcome(group, arguments, called)


def other_checkout(place: Path, running: Path) -> Path | None:
    """Return the checkout of this project that the user stands in, where another copy of it is running; else None."""
    for folder in (place, *place.parents):
        if (folder / "harness" / "__main__.py").is_file() and (folder / "mmpf" / "__init__.py").is_file():
            return None if folder.resolve() == running.resolve() else folder
    return None


def _outcome(group: TyperGroup, arguments: Sequence[str], called: str | None) -> int:
    """Run a command and turn whatever ends it into an exit code."""
    try:
        words = list(arguments) if called not in COMMANDS.own else with_values(COMMANDS[called], arguments)
        outcome = group(args=words, prog_name="python -m harness", standalone_mode=False)
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit) as error:
        if isinstance(error, SystemExit) and not isinstance(error.__context__, BrokenPipeError):
            raise
        # Typer made a SystemExit of a reader that has gone; Python would complain of it again when it flushes stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return exit_codes.READER_GONE
    except (Exception, KeyboardInterrupt) as error:
        message, exit_code = _told(error)
        return _complain(_as_typed(message, group, called) if isinstance(error, AS_TYPED) else message, exit_code)
    # Typer itself turns a Ctrl-C into this exit code.
    if outcome == exit_codes.INTERRUPTED:
        return _complain("interrupted", code_of_end())
    return outcome if isinstance(outcome, int) else exit_codes.DONE


def _told(error: BaseException) -> tuple[str, int]:
    """Return the line and the exit code for an error."""
    if isinstance(error, InputError | RunError) and error.__cause__ is not None and os.environ.get(TRACEBACK):
        # What the user's own code raised.
        traceback.print_exception(error.__cause__)
    match error:
        case RunInterruptedError() | KeyboardInterrupt():
            told = str(error) or "interrupted", code_of_end()
        case Exception() if told_to_end():
            told = "interrupted", code_of_end()
        case TyperException():
            message = error.format_message().rstrip(".").replace("argument(s)", "words, or a list without commas")
            told = (
                f"{message}{'' if message.endswith('?') else ';'} --help has options and examples",
                exit_codes.WRONG_INPUT,
            )
        case InputError() | UnknownNameError():
            told = str(error), exit_codes.WRONG_INPUT
        case RunError():
            told = str(error), exit_codes.RUN_FAILED
        case OSError():
            code = exit_codes.RUN_FAILED if error.errno in NO_ROOM else exit_codes.WRONG_INPUT
            told = f"{in_words(error)}; choose another file or folder, or make room", code
        case MemoryError():
            told = "out of memory; make the run smaller or the machine larger", exit_codes.RUN_FAILED
        case _:
            # Never the exit code 1 that Python itself ends with: that is a verdict of compare.
            if os.environ.get(TRACEBACK):
                traceback.print_exception(error)
            told = _of_the_program(error), exit_codes.INTERNAL
    return told


def _of_the_program(error: BaseException) -> str:
    """Return a sentence on where the program itself is at fault."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/harness/" in frame.filename]
    place = f" in {Path(frames[-1].filename).name}, line {frames[-1].lineno}" if frames else ""
    return (
        f"a fault of the program, not of the input: {type(error).__name__}: {error}{place}; "
        f"with {TRACEBACK}=1 in the environment the whole traceback is shown for a report"
    )


def application(called: str | None) -> typer.Typer:
    """Build the application with only the called command loaded."""
    application = typer.Typer(
        help=OVERVIEW, no_args_is_help=False, add_completion=False, rich_markup_mode="rich", invoke_without_command=True
    )
    application.callback(invoke_without_command=True)(_without_command)
    for panel, commands in PANELS.items():
        for name, about in commands.items():
            if name == called:
                application.command(name, rich_help_panel=panel)(typer_command(COMMANDS[name]))
            else:
                application.command(name, help=about, rich_help_panel=panel)(lambda: None)
    return application


def _without_command(
    context: typer.Context, version: bool = typer.Option(False, "--version", metavar="", help="Print the version.")
) -> None:
    if version:
        from importlib.metadata import version as installed_version  # noqa: PLC0415

        print(f"mmpf-harness {installed_version('mmpf-harness')}")  # noqa: T201
    elif context.invoked_subcommand is None:
        print(context.get_help())  # noqa: T201


def _as_typed(message: str, group: TyperGroup, called: str | None) -> str:
    """Return a message with the called command's parameters as they are typed, for example ``--model-file``."""
    command = group.commands.get(called or "")
    parameters = command.params if command is not None else []
    # An argument's name is what the usage line shows, for example RUN.
    typed = {
        one.name or "": one.opts[0] if isinstance(one, TyperOption) else one.metavar or one.name or ""
        for one in parameters
    }
    # A grid takes lists of what a run takes one of: there `tracker` is --trackers.
    return re.sub(r"`([a-z_]+)`", lambda match: typed.get(match[1]) or typed.get(f"{match[1]}s", match[1]), message)


def _complain(message: str, exit_code: int) -> int:
    line = "".join(each if each.isprintable() else "?" for each in " ".join(message.split()))
    if len(line) > LONGEST_LINE:
        line = f"{line[: LONGEST_LINE // 2]} ... {line[-LONGEST_LINE // 2 :]}"
    ended = exit_code in (exit_codes.HANGUP, exit_codes.INTERRUPTED, exit_codes.TERMINATED)
    # Nobody may be there to read it any more.
    with suppress(OSError):
        sys.stderr.write(f"{line}\n" if ended else f"error: {line}\n")  # a plug-in may have replaced print
    return exit_code
