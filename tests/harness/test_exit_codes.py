"""The exit codes that scripts rely on: one table, and it is what the commands do."""

import ast
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from harness.common import exit_codes
from harness.common.signals import CODES

ROOT = Path(__file__).parents[2]


def table() -> dict[int, str]:
    """Return the table of the documentation."""
    rows = re.findall(
        r"^\| (\d+) \| (.+) \|$", (ROOT / "docs" / "reference" / "exit-codes.md").read_text(), re.MULTILINE
    )
    return {int(code): meaning for code, meaning in rows}


def test_the_documented_exit_codes_are_the_codes_of_the_program():
    assert table() == exit_codes.MEANINGS
    named = {value for name, value in vars(exit_codes).items() if name.isupper() and isinstance(value, int)}
    assert named == set(exit_codes.MEANINGS)


def test_an_internal_error_and_a_signal_share_no_code_with_a_verdict():
    verdicts = {exit_codes.DONE, exit_codes.WORSE, exit_codes.UNDECIDED, exit_codes.WRONG_INPUT}
    assert exit_codes.INTERNAL not in verdicts
    # Python ends with 1 by itself where an error gets through, and with 2 on wrong options of its own.
    assert exit_codes.INTERNAL not in (0, 1, 2)
    assert not verdicts & set(CODES.values())


def test_a_signals_code_is_what_a_shell_says_of_it():
    expected = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}
    assert expected == CODES
    assert exit_codes.READER_GONE == 128 + signal.SIGPIPE


@pytest.mark.slow
@pytest.mark.parametrize("words", [["run", "--help"], ["settings"]])
def test_output_whose_reader_has_gone_ends_without_a_word(words):
    read, write = os.pipe()
    os.close(read)
    ended = subprocess.run([sys.executable, "-m", "harness", *words], stdout=write, stderr=-1, check=False, cwd=ROOT)
    os.close(write)
    assert (ended.returncode, ended.stderr) == (exit_codes.READER_GONE, b"")


def test_no_command_ends_with_a_number_of_its_own():
    for path in (ROOT / "harness" / "commands").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            number = isinstance(node, ast.Return) and type(getattr(node.value, "value", None)) is int
            raises = isinstance(node, ast.Raise) and "SystemExit" in ast.dump(node)
            assert not any((number, raises)), f"{path.name} line {node.lineno} ends with a number of its own"
