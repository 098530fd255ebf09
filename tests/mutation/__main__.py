"""Mutation score on demand: ``python -m tests.mutation --sample 240 --seed 1 [--rooms mmpf/joint]``.

Needs ``pip install mutmut``, which makes the mutants of every function of the rooms below that has no decorator (this
leaves out compiled kernels and registered functions), and finds out which fast tests call which function. A seeded
sample of the mutants, as many of each room as its share of all, is tried, each against the fast tests (of at most
``LONGEST_TEST_S``) that call its function. Prints every survivor as a difference, then the score by room and in all
with its 95 % interval.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
TESTS_OF = {
    "mmpf/joint": ("tests/mmpf/joint",),
    "harness/scoring": ("tests/harness/scoring",),
    "harness/comparison": ("tests/harness/comparison",),
    "harness/grid": ("tests/harness/grid", "tests/harness/report/test_gridruns.py"),
}
SURVIVED = (0, 5)
"""Exit codes of pytest: all tests passed, or there was none."""
SETTINGS = """\
[mutmut]
source_paths =
    mmpf
    harness
only_mutate =
{only}
also_copy =
    networks
    docs
    results
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
LONGEST_TEST_S = 3.0
"""Tests that take longer are left out; of those not marked slow hardly any does, and a tiny whole run takes two."""
SLOWER, LEAST_LIMIT_S = 5.0, 20.0
"""A mutant's tests may take this many times longer than without it, and never less than that."""


def main() -> int:
    """Try a sample of mutants and print the score."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--sample", type=int, default=240)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rooms", default=",".join(TESTS_OF), help="some of the rooms, A,B,C")
    parser.add_argument("--folder", type=Path, help="where to work, kept and used again; by default a temporary one")
    chosen = parser.parse_args()
    rooms = chosen.rooms.split(",")
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.folder or Path(temporary) / REPOSITORY.name
        if not (folder / "mutants" / "mutmut-stats.json").exists():
            copy_to(folder)
            # Makes all mutants and finds out which tests call which function, then stops for want of a name.
            told = mutmut(folder, "run", "--max-children", "2", NO_MUTANT)
            if not (folder / "mutants" / "mutmut-stats.json").exists():
                say(told)
                return 1
        names = {room: mutants_of(folder, room) for room in rooms}
        sample = sampled(names, chosen.sample, random.Random(chosen.seed))
        say(f"{sum(map(len, sample.values()))} of {sum(map(len, names.values()))} mutants, seed {chosen.seed}")
        outcomes: dict[str, int | str] = {}
        for room, mutants in sample.items():
            outcomes |= tried(folder, f"{room.replace('/', '-')}-{chosen.seed}-{chosen.sample}", mutants)
        tell(folder, sample, outcomes)
    return 0


def copy_to(folder: Path) -> None:
    """Copy what git knows of the repository, and say in a file what is to be mutated."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=REPOSITORY, capture_output=True, check=True).stdout
    for name in listed.decode().split("\0"):
        source, target = REPOSITORY / name, folder / name
        if name and source.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
    only = "\n".join(f"    {room}/*" for room in TESTS_OF)
    tests = "\n".join(f"    {test}" for tests in TESTS_OF.values() for test in tests)
    (folder / "setup.cfg").write_text(SETTINGS.format(only=only, tests=tests))


def mutmut(folder: Path, *words: str) -> str:
    """Return what mutmut says."""
    command = [sys.executable, "-m", "mutmut", *words]
    ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return ended.stdout[-3000:] + ended.stderr[-3000:]


def mutants_of(folder: Path, room: str) -> list[str]:
    """Return the names of all mutants of a room, sorted."""
    files = (folder / "mutants" / room).rglob("*.py.meta")
    return sorted(name for path in files for name in json.loads(path.read_text())["exit_code_by_key"])


def sampled(names: Mapping[str, Sequence[str]], count: int, draw: random.Random) -> dict[str, list[str]]:
    """Return a sample of each room's mutants that is its share of all."""
    whole = sum(map(len, names.values()))
    return {
        room: sorted(draw.sample(mutants, min(round(count * len(mutants) / whole), len(mutants))))
        for room, mutants in names.items()
    }


def tried(folder: Path, label: str, mutants: Sequence[str]) -> dict[str, int | str]:
    """Try mutants against the tests that call their functions, and return what came of each."""
    known = json.loads((folder / "mutants" / "mutmut-stats.json").read_text())
    seconds, callers = known["duration_by_test"], known["tests_by_mangled_function_name"]
    plan = []
    for mutant in mutants:
        fast = [test for test in callers.get(mutant.rpartition("__mutmut_")[0], ()) if seconds[test] < LONGEST_TEST_S]
        tests = sorted(fast, key=lambda test: (seconds[test], test))
        limit_s = math.ceil(max(SLOWER * sum(seconds[test] for test in tests), LEAST_LIMIT_S))
        plan.append({"mutant": mutant, "tests": tests, "limit_s": limit_s})
    asked, told = folder / f"plan-{label}.json", folder / f"told-{label}.jsonl"
    asked.write_text(json.dumps(plan))
    tree = folder / "mutants"
    command = [sys.executable, str(REPOSITORY / "tests" / "mutation" / "tried.py"), str(asked), str(told)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tree), os.environ.get("PYTHONPATH", "")])}
    subprocess.run(command, cwd=tree, env=environment, stdout=subprocess.DEVNULL, check=True)
    rows = [json.loads(line) for line in told.read_text().splitlines()]
    return {row["mutant"]: row["outcome"] for row in rows}


def tell(folder: Path, sample: Mapping[str, Sequence[str]], outcomes: Mapping[str, int | str]) -> None:
    """Print the survivors, and how many were killed, by room and in all."""
    killed = {name for name, outcome in outcomes.items() if outcome not in SURVIVED}
    for mutants in sample.values():
        for name in sorted(set(mutants) - killed):
            say(f"{name} (no test calls it)" if outcomes[name] == 5 else mutmut(folder, "show", name))
    for room, mutants in sample.items():
        say(f"{room:20} {score(len(killed & set(mutants)), len(mutants))}")
    say(f"{'all':20} {score(len(killed), len(outcomes))}; {Counter(map(str, outcomes.values()))}")


def score(killed: int, count: int) -> str:
    """Return a share with its 95 % interval, Wilson's."""
    count = max(count, 1)
    share, z2 = killed / count, 1.96**2
    middle, half = share + z2 / (2 * count), 1.96 * math.sqrt(share * (1 - share) / count + z2 / (4 * count**2))
    low, high = ((middle + side * half) / (1 + z2 / count) for side in (-1, 1))
    return f"{killed:4d} of {count:4d} killed: {100 * share:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
