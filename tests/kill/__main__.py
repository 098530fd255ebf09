"""Ends on demand: ``python -m tests.kill --kills 40 --seed 1 [--dask]``, or ``--full-disks 20`` in place of kills.

Exit code 1 if anything was lost.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.kill.filling import can_mount, fill_often, in_own_name_space
from tests.kill.killing import kill_often

INSIDE = "MMPF_OWN_MOUNTS"


def main() -> int:
    """Kill or fill as often as is asked for and print what came of each."""
    parser = argparse.ArgumentParser(prog="python -m tests.kill", description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--full-disks", type=int, default=0, help="so many disks that are too small, and no kills")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dask", action="store_true", help="kill grids on a Dask cluster as well, started for it")
    chosen = parser.parse_args()
    if chosen.full_disks and INSIDE not in os.environ:
        if not can_mount():
            parser.error("--full-disks: this system lets nobody but its administrator mount a disk")
        os.environ[INSIDE] = "1"
        return in_own_name_space(["tests.kill", *sys.argv[1:]])
    with tempfile.TemporaryDirectory() as folder:
        if chosen.full_disks:
            ends = fill_often(chosen.full_disks, chosen.seed, Path(folder), lambda filled: _say(filled.as_line()))
            counts = Counter((filled.command, filled.outcome) for filled in ends)
        else:
            ends = kill_often(chosen.kills, chosen.seed, Path(folder), lambda kill: _say(kill.as_line()), chosen.dask)
            counts = Counter((kill.command, kill.signal.name, kill.outcome) for kill in ends)
    for what, count in sorted(counts.items()):
        _say(f"{count:4d}  {'  '.join(f'{word:7}' for word in what)}")
    faults = [end for end in ends if end.faults]
    _say(f"{len(ends)} ends, {len(faults)} with faults")
    return 1 if faults else 0


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
