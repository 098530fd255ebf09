"""The process in which spoilt inputs or odd networks are read, one after the other, until it is done or dies of one.

It tells of each case before and after it, a line of JSON each, on the file that it is given.
"""

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
from harness.report import pictures
from tests.fuzz.inputs import INPUTS
from tests.fuzz.mutations import DONE
from tests.fuzz.odd_networks import chosen

# What the commands are told to write, or do in the folder that they are given.
WRITTEN = ("out", "run/report.html", "run/figures", "run/.mmpf-harness.json", "run/export", "results")


def main() -> None:
    """Run the cases from the first to the last number, both given, of a seed, or of odd networks if that is ``odd``."""
    seed, first, last, told = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    faulthandler.enable()
    log = told.open("a", encoding="utf-8")
    errors = told.with_suffix(".stderr")
    home = Path.cwd()
    for number in range(first, last):
        folder = Path(tempfile.mkdtemp(prefix=f"fuzz-{number}-"))
        os.chdir(folder)
        DONE.clear()
        kind, words = odd(folder, number) if seed == "odd" else spoilt(folder, number, seed)
        log.write(json.dumps({"begin": number, "kind": kind, "command": words, "spoilt": DONE}) + "\n")
        log.flush()
        (folder / "victim").write_text("precious")
        before = state_of(folder)
        begin = time.perf_counter()
        code = captured(words, errors)
        message = errors.read_text(encoding="utf-8", errors="replace")
        after = state_of(folder)
        written = [name for name, size in after.items() if before.get(name) != size and not name.startswith(WRITTEN)]
        row = {"end": number, "code": code, "seconds": time.perf_counter() - begin, "stderr": message[-4000:]}
        # What is mapped and never touched, as libraries do, does not count, nor what the process before this one held.
        own = int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
        row["peak_bytes"] = 1024 * max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
        row["written"] = written + [name for name in before if name not in after]
        log.write(json.dumps(row) + "\n")
        log.flush()
        os.chdir(home)
        shutil.rmtree(folder, ignore_errors=True)


def spoilt(folder: Path, number: int, seed: str) -> tuple[str, list[str]]:
    """Make the input of a number, and return its kind and the command that reads it."""
    kind = sorted(INPUTS)[number % len(INPUTS)]
    return kind, INPUTS[kind](folder, random.Random(f"{seed}-{number}"))


def odd(folder: Path, number: int) -> tuple[str, list[str]]:
    """Make an odd network, and return its kind and the command that drives on it."""
    pictures.draw_charts = lambda *_: None  # of errors over time; no network shows in them
    name, make = list(chosen().items())[number]
    DONE.append(name)
    words = ["run", "--net", str(make().write(folder)), "--duration", "1", "--particles", "30"]
    return "network", [*words, "--out", "out", "--quiet"]


def state_of(folder: Path) -> dict[str, tuple[int, int]]:
    """Return size and time of each file below a folder, by its name."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): (path.stat().st_size, path.stat().st_mtime_ns) for path in files}


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
