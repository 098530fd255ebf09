"""Kills on demand: ``python -m tests.kill --kills 40 --seed 1 [--dask]``; exit code 1 if anything was lost."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.kill.killing import kill_often


def main() -> int:
    """Kill as often as is asked for and print what came of each."""
    parser = argparse.ArgumentParser(prog="python -m tests.kill", description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dask", action="store_true", help="grids on a Dask cluster as well, started for it")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        kills = kill_often(chosen.kills, chosen.seed, Path(folder), lambda kill: _say(kill.as_line()), chosen.dask)
    counts = Counter((kill.command, kill.signal.name, kill.outcome) for kill in kills)
    for (command, signal, outcome), count in sorted(counts.items()):
        _say(f"{count:4d}  {command:6}  {signal:7}  {outcome}")
    faults = [kill for kill in kills if kill.faults]
    _say(f"{len(kills)} kills, {len(faults)} with faults")
    return 1 if faults else 0


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
