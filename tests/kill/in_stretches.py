"""The command line with runs that keep every episode as a stretch of its own, as by themselves only long runs do."""

from __future__ import annotations

import sys

from harness.commands.app import run_command_line
from harness.running import evaluate

if __name__ == "__main__":
    evaluate.STRETCH_ROWS = 1
    sys.exit(run_command_line(sys.argv[1:]))
