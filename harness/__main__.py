"""Entry point of ``python -m harness``."""

from __future__ import annotations

import sys

from harness.common.signals import code_of_end, ends_like_ctrl_c, ignore_ends
from harness.common.watching import watched


def main() -> None:
    """Run the command line and leave with its exit code."""
    sys.exit(watched(sys.argv[1:], _command))


def _command() -> int:
    with ends_like_ctrl_c():
        try:
            # Only now: to be told to end while modules are read is no error either.
            from harness.commands.app import run_command_line  # noqa: PLC0415

            code = run_command_line(sys.argv[1:])
        except KeyboardInterrupt:
            code = code_of_end()
        # All is done and told: what ends the process from here on must not look like an error.
        ignore_ends()
    return code


if __name__ == "__main__":
    main()
