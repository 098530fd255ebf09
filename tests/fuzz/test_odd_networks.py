"""Networks that are broken or strange give a run or one clear line: never a traceback, a crash or a hang."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

from tests.fuzz.odd_networks import EXPECTED, ODD, chosen
from tests.fuzz.test_fuzz import BUSY, LONGEST_S, ROOT, STARTING_S, Case, processor_s, rows_of

FEWEST = 50


def drive_on_all(folder) -> list[Case]:
    """Drive on all of them in child processes: one that hangs or dies costs its network, and another goes on behind."""
    cases: list[Case] = []
    while len(cases) < len(chosen()):
        told = folder / f"told-{len(cases)}.jsonl"
        command = [sys.executable, "-m", "tests.fuzz.odd_child", str(len(cases)), str(told)]
        with (folder / "child.stderr").open("wb") as complaints:
            child = subprocess.Popen(command, cwd=ROOT, stderr=complaints)
        size, since, worked_s, hung = -1, time.monotonic(), 0.0, False
        while child.poll() is None and not hung:
            time.sleep(0.1)
            now = told.stat().st_size if told.exists() else 0
            if now != size:
                size, since, worked_s = now, time.monotonic(), processor_s(child.pid)
            longest_s = LONGEST_S if size else STARTING_S
            hung = processor_s(child.pid) - worked_s > longest_s or time.monotonic() - since > BUSY * longest_s
        child.kill()
        child.wait()
        before = len(cases)
        for row in rows_of(told):
            if "begin" in row:
                cases.append(Case(row["begin"], row["kind"], row["command"], row["spoilt"]))
            else:
                cases[-1].code, cases[-1].stderr = row["code"], row["stderr"]
        assert len(cases) > before, (folder / "child.stderr").read_text()[-2000:]
        if cases[-1].code is None:
            cases[-1].stderr = "hangs" if hung else f"died with {child.returncode}"
    return cases


def test_there_are_at_least_fifty_odd_networks():
    assert len(ODD) >= FEWEST


@pytest.mark.slow
def test_every_odd_network_gives_a_run_or_one_clear_line(tmp_path):
    cases = drive_on_all(tmp_path)
    faults = [f"{case.spoilt[0]}: {case.fault()}: {case.stderr[-500:]}" for case in cases if case.fault()]
    assert not faults, "\n".join(faults)
    assert {case.spoilt[0]: case.code for case in cases if case.spoilt[0] in EXPECTED} == EXPECTED
