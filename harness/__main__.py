"""Entry point of ``python -m harness``."""

import signal
import sys


def main() -> None:
    """Run the command line and leave with its exit code."""
    # Who ends it while modules are read is heard once they are; until then Python would print where it was.
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    from harness.common.watching import watched  # noqa: PLC0415

    sys.exit(watched("harness.commands.app:run_command_line", sys.argv[1:]))


if __name__ == "__main__":
    main()
