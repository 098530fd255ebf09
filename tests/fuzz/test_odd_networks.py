"""Networks that are broken or strange give a run or one clear line: never a traceback, a crash or a hang."""

import pytest

from tests.fuzz.odd_networks import EXPECTED, ODD, chosen
from tests.fuzz.watched import run_cases

FEWEST = 50


def test_there_are_at_least_fifty_odd_networks():
    assert len(ODD) >= FEWEST


@pytest.mark.slow
def test_every_odd_network_gives_a_run_or_one_clear_line(tmp_path):
    cases = run_cases(tmp_path, ["tests.fuzz.child", "odd"], 0, len(chosen()))
    assert len(cases) == len(chosen())
    faults = [f"{case.spoilt[0]}: {case.fault()}: {case.stderr[-500:]}" for case in cases if case.fault()]
    assert not faults, "\n".join(faults)
    assert {case.spoilt[0]: case.code for case in cases if case.spoilt[0] in EXPECTED} == EXPECTED
