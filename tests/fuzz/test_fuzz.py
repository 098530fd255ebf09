"""Spoilt inputs of every kind end in time, in bounds, with a documented exit code and without a traceback.

``HARNESS_FUZZ_CASES`` and ``HARNESS_FUZZ_SEED`` set how many there are and which, ``HARNESS_FUZZ_FIRST`` at which of
them to begin. To the file that ``HARNESS_FUZZ_REPORT`` names a line of JSON is added for each, with what was changed:
whether an accepted one is nonsense is for a reader to say.
"""

import json
import os
from collections import Counter
from pathlib import Path

import pytest

from harness.common import exit_codes
from tests.fuzz.watched import run_cases

CASES, SEED = int(os.environ.get("HARNESS_FUZZ_CASES", "36")), int(os.environ.get("HARNESS_FUZZ_SEED", "1"))
FIRST = int(os.environ.get("HARNESS_FUZZ_FIRST", "0"))


@pytest.mark.slow
def test_no_spoilt_input_ends_in_a_traceback_a_hang_or_an_unknown_exit_code(tmp_path):
    cases = run_cases(tmp_path, ["tests.fuzz.child", str(SEED)], FIRST, FIRST + CASES)
    assert len(cases) == CASES
    report = os.environ.get("HARNESS_FUZZ_REPORT")
    if report:
        with Path(report).open("a", encoding="utf-8") as file:
            file.writelines(json.dumps(vars(case) | {"fault": case.fault()}) + "\n" for case in cases)
    faulty = [case for case in cases if case.fault()]
    faults = [f"{case.number} {case.kind}: {case.fault()}: {case.command}\n{case.stderr[-1500:]}" for case in faulty]
    assert not faults, "\n\n".join(faults)
    codes = Counter(case.code for case in cases)
    assert codes[exit_codes.WRONG_INPUT] > CASES / 4, "hardly anything was refused: the inputs are no test"
