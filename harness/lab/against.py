"""Is a step slower than at an earlier revision: both run in turns, scan by scan, on the same scenes.

A machine that others use has no speed of its own, so only ratios of neighbouring steps say anything; and one process is
some per cent faster than the next of the same code, as memory falls out, so several pairs of processes are measured.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.lab.bench import FEWEST_STEPS, SETTLING_STEPS, BenchPlan

PAIRS = 6
"""Pairs of processes. The true median lies between the least and the greatest of six in 97 % of cases."""
CHILD = """
import json, sys, time
from harness.lab.bench import BenchPlan, run_bench

begin = None

def advance():
    global begin
    print("" if begin is None else 1e3 * (time.process_time() - begin), file=told, flush=True)
    sys.stdin.readline() or sys.exit()
    begin = time.process_time()

told, sys.stdout = sys.stdout, sys.stderr
plan = json.loads(sys.argv[1])
run_bench(BenchPlan(**plan | {key: tuple(plan[key]) for key in ("vehicles", "trackers")}), advance)
"""


@contextmanager
def stepped_bench(tree: Path, plan: BenchPlan) -> Iterator[Callable[..., float]]:
    """Run the bench of a checkout in a process of its own, which ends with the block.

    Yields what lets it take the next scan and returns its processor time in ms; of the first, taken unasked, nan.
    """
    paths = os.pathsep.join([str(tree), *filter(None, [os.environ.get("PYTHONPATH")])])
    words, environment = [sys.executable, "-c", CHILD, json.dumps(asdict(plan))], os.environ | {"PYTHONPATH": paths}
    with tempfile.TemporaryFile("w+") as errors:
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": errors, "text": True}
        process = subprocess.Popen(words, cwd=tree, env=environment, **pipes)  # type: ignore[call-overload]

        def step(begins: bool = True) -> float:
            with suppress(BrokenPipeError):
                process.stdin.write("\n" * begins)
                process.stdin.flush()
            if line := process.stdout.readline():
                return float(line.strip() or "nan")
            errors.seek(0)
            kind, _, text = (errors.read().strip().splitlines() or ["it ended"])[-1].partition(": ")
            if kind.endswith("InputError"):
                raise InputError(text)
            raise InputError(f"`against`: no bench can be run there ({kind}: {text}); choose a later revision")

        try:
            yield step
        finally:
            process.kill()
            process.communicate()


def time_ratios(revision: str, plan: BenchPlan, advance: Callable[[], None]) -> list[dict[str, Any]]:
    """Return a row for each tracker and number of vehicles: times now and then, and their ratio with its interval.

    ``advance`` is called ``PAIRS * (plan.steps - 1)`` times for each row.

    Raises:
        InputError: This is no git checkout, it has no such revision, or a tracker can't be timed in both.
    """
    here, rows = Path(__file__).resolve().parents[2], []
    with checked_out(here, revision) as there:
        for tracker in plan.trackers:
            for vehicles in plan.vehicles:
                one = BenchPlan((vehicles,), (tracker,), plan.particles, plan.steps, plan.seed, budget_s=1e9)
                times = np.array([time_pair((here, there), one, advance) for _ in range(PAIRS)])
                row = {"tracker": tracker, "vehicles": vehicles, "particles": plan.particles}
                rows.append(row | judged(times))
    return rows


def judged(times_ms: np.ndarray) -> dict[str, Any]:
    """Return the verdict on times now and then, shape (pairs, 2, steps): each pair has the median of its ratios."""
    ratios = np.median(times_ms[:, 0] / times_ms[:, 1], axis=1)
    low, high = float(ratios.min()), float(ratios.max())
    now, then = np.median(times_ms, axis=(0, 2))
    verdict = "slower" if low > 1.0 else "faster" if high < 1.0 else "no difference shown"
    figures = {"cpu_ms": float(now), "cpu_ms_then": float(then), "ratio": float(np.median(ratios))}
    return figures | {"low": low, "high": high, "verdict": verdict}


def time_pair(trees: Sequence[Path], plan: BenchPlan, advance: Callable[[], None]) -> np.ndarray:
    """Return the processor times in ms of the settled steps in two checkouts that take turns, shape (2, steps)."""
    times = np.empty((2, plan.steps - 1))
    with stepped_bench(trees[0], plan) as now, stepped_bench(trees[1], plan) as then:
        both = now, then
        for take in both:
            take(begins=False)
        for step in range(plan.steps - 1):
            # Who comes first finds the caches as the other left them: in turns too.
            for side in (0, 1) if step % 2 else (1, 0):
                times[side, step] = both[side]()
            advance()
    return times[:, min(SETTLING_STEPS, plan.steps - 1 - FEWEST_STEPS) :]


@contextmanager
def checked_out(repository: Path, revision: str) -> Iterator[Path]:
    """Hand over a folder that holds a revision while the block runs.

    Raises:
        InputError: The folder is no git checkout, or has no such revision.
    """

    def git(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(["git", "-C", str(repository), *words], capture_output=True, text=True, check=False)

    try:
        is_checkout = git("rev-parse", "--show-toplevel").stdout.strip() == str(repository)
    except FileNotFoundError:
        raise InputError(f"`against` {revision}: needs git, which is not installed") from None
    if not is_checkout:
        raise InputError(f"`against` {revision}: {repository} is no git checkout; run the harness from a clone")
    found = git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{revision}^{{commit}}")
    if found.returncode:
        raise InputError(f"`against` {revision}: there is no such revision; give a commit, branch or tag")
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        tree = Path(folder) / "tree"
        added = git("worktree", "add", "--detach", "--quiet", str(tree), found.stdout.strip())
        if added.returncode:
            raise InputError(f"`against` {revision}: git can't check it out: {added.stderr.strip().splitlines()[-1]}")
        try:
            yield tree
        finally:
            git("worktree", "remove", "--force", str(tree))
