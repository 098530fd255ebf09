"""The process in which spoilt inputs are read, one after the other, until it is done or dies of one.

It tells of each case before and after it, a line of JSON each, on the file that it is given.
"""

from __future__ import annotations

import faulthandler
import json
import os
import random
import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path

from harness.commands.app import run_command_line
from tests.fuzz.inputs import INPUTS
from tests.fuzz.mutations import DONE

MOST_BYTES = 2 << 30


def main() -> None:
    """Run the cases from the first to the last number, both given, of a seed."""
    seed, first, last, told = int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    # Private memory: what is mapped and never touched, as libraries do, does not count.
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES))
    faulthandler.enable()
    log = told.open("a", encoding="utf-8")
    errors = told.with_suffix(".stderr")
    home = Path.cwd()
    for number in range(first, last):
        rng = random.Random(f"{seed}-{number}")
        kind = sorted(INPUTS)[number % len(INPUTS)]
        folder = Path(tempfile.mkdtemp(prefix=f"fuzz-{number}-"))
        os.chdir(folder)
        DONE.clear()
        words = INPUTS[kind](folder, rng)
        log.write(json.dumps({"begin": number, "kind": kind, "command": words, "spoilt": DONE}) + "\n")
        log.flush()
        begin = time.perf_counter()
        code = captured(words, errors)
        message = errors.read_text(encoding="utf-8", errors="replace")
        row = {"end": number, "code": code, "seconds": time.perf_counter() - begin, "stderr": message[-4000:]}
        log.write(json.dumps(row) + "\n")
        log.flush()
        os.chdir(home)
        shutil.rmtree(folder, ignore_errors=True)


def captured(words: list[str], errors: Path) -> int:
    """Run a command with what it prints, SUMO's C++ included, going to a file."""
    kept = os.dup(1), os.dup(2)
    with errors.open("wb") as file, open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(file.fileno(), 2)
        try:
            return run_command_line(words)
        except SystemExit as end:
            return int(end.code or 0)
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            for number, descriptor in enumerate(kept, start=1):
                os.dup2(descriptor, number)
                os.close(descriptor)


if __name__ == "__main__":
    main()
