"""Entry point of ``python -m harness``."""

import os
import re
import signal
import sys
from importlib.util import find_spec


def main() -> None:
    """Run the command line and leave with its exit code."""
    # A signal that comes while modules are loaded waits until they are: Python would answer it with a traceback.
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    if missing := [name for name in ("numpy", "pydantic", "typer") if find_spec(name) is None]:
        where = "activate the environment in which you installed the harness"
        sys.stderr.write(f"error: {sys.executable} has no {missing[0]}; {where}\n")
        sys.exit(2)
    threads = os.environ.get("NUMBA_NUM_THREADS", "")
    if re.fullmatch(r"\s*(-\s*\d+|\+?0+)\s*", threads):
        sys.stderr.write(f"error: NUMBA_NUM_THREADS is {threads}; set it to 1 or more, or unset it\n")
        sys.exit(2)
    from harness.common.watching import watched  # noqa: PLC0415

    sys.exit(watched("harness.commands.app:run_command_line", sys.argv[1:]))


if __name__ == "__main__":
    main()
