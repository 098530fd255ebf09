"""The command line with another time between frames: ``python -m tests.rates.at_rate STEP_S run ...``."""

from __future__ import annotations

import sys

from harness.truth import frame

if __name__ == "__main__":
    # Others take the constant over when they are imported.
    frame.STEP_S = float(sys.argv[1])
    from harness.commands.app import run_command_line

    sys.exit(run_command_line(sys.argv[2:]))
