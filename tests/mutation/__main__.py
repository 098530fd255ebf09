"""Mutation score on demand: ``python -m tests.mutation --sample 160 --seed 1 [--rooms mmpf/joint]``.

Needs ``pip install mutmut``. Mutants are made of every function of the rooms below that has no decorator, which leaves
out compiled kernels and registered functions; a seeded sample of them is run, each against the fast tests that call its
function. Prints the score by room and every survivor as a difference.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
TESTS_OF = {
    "mmpf/joint": ("tests/mmpf/joint",),
    "harness/scoring": ("tests/harness/scoring",),
    "harness/comparison": ("tests/harness/comparison",),
    "harness/grid": ("tests/harness/grid",),
}
KILLED, TIMED_OUT = (1, 3), (24, 36, 152, 255)
SETTINGS = """\
[mutmut]
source_paths =
    mmpf
    harness
only_mutate =
{only}
also_copy =
    networks
    README.md
pytest_add_cli_args_test_selection =
{tests}
pytest_add_cli_args =
    -p
    no:cacheprovider
    --hypothesis-seed=0
on_dependency_change = ignore
"""
NO_MUTANT = "no mutant has this name"


def main() -> int:
    """Run a sample of mutants and print the score."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--sample", type=int, default=160)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rooms", default=",".join(TESTS_OF), help="some of the rooms, A,B,C")
    parser.add_argument("--folder", type=Path, help="where to work, kept and used again; by default a temporary one")
    chosen = parser.parse_args()
    rooms = chosen.rooms.split(",")
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.folder or Path(temporary) / REPOSITORY.name
        copy_to(folder, rooms)
        # Makes all mutants and finds out which tests call which function, then stops for want of a name.
        mutmut(folder, [NO_MUTANT])
        names = sorted(outcomes(folder))
        sample = sorted(random.Random(chosen.seed).sample(names, min(chosen.sample, len(names))))
        say(f"{len(sample)} of {len(names)} mutants, seed {chosen.seed}")
        if not mutmut(folder, sample):
            return 1
        tell(folder, sample, rooms)
    return 0


def copy_to(folder: Path, rooms: Sequence[str]) -> None:
    """Copy what git knows of the repository, and say in a file what is to be mutated."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=REPOSITORY, capture_output=True, check=True).stdout
    for name in listed.decode().split("\0"):
        source, target = REPOSITORY / name, folder / name
        if name and source.is_file() and not name.startswith(("results/", "docs/")):
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
    only = "\n".join(f"    {room}/*" for room in rooms)
    tests = "\n".join(f"    {test}" for room in rooms for test in TESTS_OF[room])
    (folder / "setup.cfg").write_text(SETTINGS.format(only=only, tests=tests))


def mutmut(folder: Path, names: Sequence[str]) -> bool:
    """Run mutants by name, and return whether that went well; what went wrong is printed."""
    words = [sys.executable, "-m", "mutmut", "run", "--max-children", "2", *names]
    ended = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    if ended.returncode and NO_MUTANT not in names:
        say(ended.stdout[-3000:] + ended.stderr[-3000:])
    return ended.returncode == 0


def outcomes(folder: Path) -> dict[str, int | None]:
    """Return the exit code of each mutant's tests by its name; None of one that was not run."""
    found: dict[str, int | None] = {}
    for path in (folder / "mutants").rglob("*.py.meta"):
        found |= json.loads(path.read_text())["exit_code_by_key"]
    return found


def tell(folder: Path, sample: Sequence[str], rooms: Sequence[str]) -> None:
    """Print how many were killed, by room and in all, and the survivors."""
    codes = outcomes(folder)
    killed = {name for name in sample if codes[name] in (*KILLED, *TIMED_OUT)}
    in_room = {name: next(room for room in rooms if name.startswith(room.replace("/", "."))) for name in sample}
    of_room, killed_of = Counter(in_room.values()), Counter(in_room[name] for name in killed)
    for name in sample:
        if name not in killed:
            words = [sys.executable, "-m", "mutmut", "show", name]
            say(subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False).stdout)
    for room, count in of_room.items():
        say(f"{room:20} {killed_of[room]:4d} of {count:4d} killed")
    say(f"score {100.0 * len(killed) / max(len(sample), 1):.1f} % of {len(sample)}")


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
