"""Entry point of ``python -m harness``."""

import signal
import sys


def main() -> None:
    """Run the command line and leave with its exit code."""
    # A signal that comes while modules are loaded waits until they are: Python would answer it with a traceback.
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    from harness.common.watching import watched  # noqa: PLC0415

    sys.exit(watched("harness.commands.app:run_command_line", sys.argv[1:]))


if __name__ == "__main__":
    main()
