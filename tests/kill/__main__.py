"""Ends on demand: ``python -m tests.kill --kills 40 --seed 1 [--dask]``; exit code 1 if anything was lost."""

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
    parser.add_argument("--dask", action="store_true", help="kill grids on a Dask cluster as well, started for it")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        ends = kill_often(chosen.kills, chosen.seed, Path(folder), lambda kill: _say(kill.as_line()), chosen.dask)
    for what, count in sorted(Counter((kill.command, kill.signal.name, kill.outcome) for kill in ends).items()):
        _say(f"{count:4d}  {'  '.join(f'{word:7}' for word in what)}")
    faults = [end for end in ends if end.faults]
    _say(f"{len(ends)} ends, {len(faults)} with faults")
    return 1 if faults else 0


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
