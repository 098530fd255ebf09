import subprocess
from contextlib import nullcontext

import numpy as np
import pytest

from harness.commands.app import run_command_line
from harness.common.errors import InputError
from harness.lab import against
from harness.lab.against import checked_out, judged, time_pair
from harness.lab.bench import BenchPlan

BENCH = """
import time
from dataclasses import dataclass

@dataclass
class BenchPlan:
    vehicles: tuple; trackers: tuple; particles: int; steps: int; seed: int; budget_s: float

def run_bench(plan, advance):
    assert plan.vehicles == (5,) and plan.trackers == ("mine",)
    for _ in range(plan.steps):
        end = time.process_time() + {work_s}
        while time.process_time() < end:
            pass
        print("this is no time")
        advance()
"""
PLAN = BenchPlan(vehicles=(5,), trackers=("mine",), steps=12)


def checkout_that_works(folder, work_s):
    (folder / "harness" / "lab").mkdir(parents=True)
    for package in ("harness", "harness/lab"):
        (folder / package / "__init__.py").touch()
    (folder / "harness" / "lab" / "bench.py").write_text(BENCH.replace("{work_s}", str(work_s)))
    return folder


def git(folder, *words):
    person = ("-c", "user.name=a", "-c", "user.email=a@example.org")
    subprocess.run(["git", "-C", str(folder), *person, *words], check=True, capture_output=True)


def test_each_step_of_both_checkouts_is_timed_and_a_third_of_the_work_is_a_third_of_the_time(tmp_path):
    trees = [checkout_that_works(tmp_path / name, work_s) for name, work_s in (("now", 0.01), ("then", 0.03))]
    told = []
    times_ms = time_pair(trees, PLAN, lambda: told.append(1))
    assert (len(told), times_ms.shape) == (11, (2, 3))
    assert judged(times_ms[None])["ratio"] == pytest.approx(1 / 3, rel=0.1)


@pytest.mark.parametrize(
    ("ratios", "verdict"),
    [((1.02, 1.1, 1.3), "slower"), ((0.5, 0.9, 0.99), "faster"), ((0.9, 1.1, 1.3), "no difference shown")],
)
def test_a_step_is_slower_only_if_it_is_in_every_pair(ratios, verdict):
    times_ms = np.array([[[20.0 * ratio] * 5, [20.0] * 5] for ratio in ratios])
    found = judged(times_ms)
    assert (found["low"], found["ratio"], found["high"], found["verdict"]) == pytest.approx((*ratios, verdict))


def test_one_odd_step_moves_no_ratio():
    times_ms = np.full((6, 2, 9), 20.0)
    times_ms[:, 0, 4] = 500.0
    assert judged(times_ms)["ratio"] == 1.0


def test_a_bench_that_fails_is_told_in_a_line(tmp_path):
    trees = [checkout_that_works(tmp_path / name, 0.0) for name in ("now", "then")]
    (trees[1] / "harness" / "lab" / "bench.py").write_text("")
    with pytest.raises(InputError, match=r"^`against`: .*ImportError.*$"):
        time_pair(trees, PLAN, lambda: None)


def test_a_revision_is_checked_out_beside_and_taken_away_again(tmp_path):
    git(tmp_path, "init", "--quiet")
    for text in ("old", "new"):
        (tmp_path / "file").write_text(text)
        git(tmp_path, "add", "file")
        git(tmp_path, "commit", "--message", text)
    with checked_out(tmp_path, "HEAD~1") as tree:
        assert ((tree / "file").read_text(), (tmp_path / "file").read_text()) == ("old", "new")
    assert not tree.exists()
    assert not list((tmp_path / ".git").glob("worktrees/*"))
    with pytest.raises(InputError, match="no such revision"), checked_out(tmp_path, "--all"):
        pass


def test_a_folder_without_git_is_refused_on_the_command_line(tmp_path, monkeypatch, refused):
    monkeypatch.setattr(against, "__file__", str(tmp_path / "harness" / "lab" / "against.py"))
    assert "--against HEAD" in (told := refused("bench", "--against", "HEAD"))
    assert "no git checkout" in told


def test_the_command_ends_with_1_if_a_step_is_slower(tmp_path, monkeypatch):
    monkeypatch.setattr(against, "checked_out", lambda *_: nullcontext(tmp_path))
    for work, code in ((2.0, 1), (0.5, 0)):
        times_ms = np.array([[[work], [1.0]]])
        monkeypatch.setattr(against, "time_pair", lambda *_, times_ms=times_ms: times_ms[0])
        assert run_command_line(["bench", "--against", "HEAD", "--quiet", "--out", str(tmp_path)]) == code
