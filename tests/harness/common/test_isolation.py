"""What is read in a fork can do nothing but tell what it found; whatever becomes of it is one line."""

import ctypes
import os
import socket
import sys
import time
from pathlib import Path
from types import FunctionType

import numpy as np
import pytest

from harness.common import untrusted_files
from harness.common.errors import InputError, RunError
from harness.common.isolation import ProcessLimits, isolated, streamed
from harness.common.streams import to_stderr

pytestmark = pytest.mark.forks

SHORT = ProcessLimits(cpu_s=1)


def writes(path: Path) -> None:
    path.write_text("written")


def never_ends() -> None:
    while True:
        pass


def nested() -> object:
    found: object = []
    for _ in range(100_000):
        found = [found]
    return found


@pytest.mark.parametrize(
    ("work", "told"),
    [
        (lambda: np.ones(10**9), "needs more than 1.25 GB of memory"),
        (lambda: ctypes.string_at(0), "crashed while reading it (SIGSEGV)"),
        (os.abort, "crashed while reading it (SIGABRT)"),
        (lambda: os._exit(0), "crashed while reading it (exit code 0)"),
        pytest.param(never_ends, "took more than 1 s", marks=pytest.mark.slow),
        (lambda: os.execv("/bin/true", ["true"]), "PermissionError"),
        (lambda: socket.create_connection(("127.0.0.1", 9)), "PermissionError"),
        (lambda: (_ for _ in ()).throw(StopIteration), "RuntimeError"),
        (nested, "nested too deeply"),
        (lambda: {}["a"], "KeyError: 'a'"),
    ],
)
def test_every_end_of_a_fork_is_one_line_that_names_what_was_read(work, told):
    with pytest.raises(InputError) as error:
        isolated(work, "`net`: file.xml", SHORT)
    assert str(error.value).startswith("`net`: file.xml: ")
    assert told in str(error.value)


def test_a_fork_needs_no_stderr(monkeypatch):
    monkeypatch.setattr(sys, "stderr", None)
    to_stderr("nobody reads it")
    assert isolated(lambda: 3, "file") == 3


@pytest.mark.slow
def test_signs_of_life_give_no_more_time():
    def work(send):
        while True:
            send(None)

    with pytest.raises(InputError, match="took more than 1 s"):
        next(streamed(work, "file", SHORT))


def test_what_sleeps_for_ever_is_ended_too():
    begin = time.perf_counter()
    with pytest.raises(InputError, match="took more than 0 s"):
        isolated(lambda: time.sleep(60.0), "file", ProcessLimits(cpu_s=0))
    assert time.perf_counter() - begin < 5.0


def test_a_fork_writes_nowhere_but_in_its_own_folder(tmp_path):
    own, other = tmp_path / "own", tmp_path / "other"
    own.mkdir()
    other.write_text("precious")

    def work(send):
        Path("relative").write_text("written")
        Path("/dev/null").write_text("written")
        for path in (other, tmp_path / "new"):
            try:
                path.write_text("written")
            except PermissionError:
                send(path.name)

    assert list(streamed(work, "file", folders=(own,))) == ["other", "new"]
    assert other.read_text() == "precious"
    assert [path.name for path in own.iterdir()] == ["relative"]
    with pytest.raises(InputError, match="PermissionError"):
        isolated(lambda: writes(tmp_path / "new"), "file")
    assert not (tmp_path / "new").exists()


def test_without_landlock_a_fork_still_writes_no_byte(tmp_path, monkeypatch):
    monkeypatch.setattr("harness.common.isolation.confine", lambda folders: False)
    with pytest.raises(InputError, match="File too large"):
        isolated(lambda: writes(tmp_path / "new"), "file")


def test_results_and_errors_come_through_as_they_are():
    def fails(error):
        raise error

    table = np.arange(12.0).reshape(3, 4)
    found = isolated(lambda: {"table": table, "names": ("a", "b")}, "file")
    assert np.array_equal(found["table"], table)
    assert found["table"].flags.writeable
    assert found["names"] == ("a", "b")
    assert isolated(lambda: isolated(lambda: 3, "inner"), "outer") == 3
    for error in (InputError("what is wrong"), RunError("what failed")):
        with pytest.raises(type(error), match=str(error)):
            isolated(lambda error=error: fails(error), "file")


def test_a_stream_that_is_left_half_way_leaves_no_process_behind():
    def work(send):
        while True:
            send(os.getpid())

    told = streamed(work, "file")
    child = next(told)
    told.close()
    with pytest.raises(ChildProcessError):
        os.waitpid(child, os.WNOHANG)


def test_what_a_fork_starts_ends_with_it():
    def work():
        child = os.fork()
        if not child:
            time.sleep(60.0)
            os._exit(0)
        return child

    left = isolated(work, "file")
    for _ in range(100):
        try:
            state = Path(f"/proc/{left}/stat").read_text().rsplit(")", 1)[1].split()[0]
        except OSError:
            return
        if state == "Z":
            return
        time.sleep(0.05)
    pytest.fail("it lives on")


def test_a_file_with_holes_gives_no_right_to_more_memory(tmp_path):
    with (tmp_path / "holes").open("wb") as file:
        file.truncate(6 << 30)
    assert ProcessLimits.for_files([tmp_path / "holes"]) == ProcessLimits()


def test_a_fault_of_the_reader_itself_is_not_told_as_broken_input(monkeypatch, tmp_path):
    (tmp_path / "a.json").write_text('{"a": 1}')

    def faulty(*_):
        raise NameError("name 'jsn' is not defined")

    # Within a module of the program, as its own code would raise it.
    monkeypatch.setattr(untrusted_files, "read_text", FunctionType(faulty.__code__, vars(untrusted_files)))
    with pytest.raises(RuntimeError, match="NameError: name 'jsn' is not defined"):
        isolated(lambda: untrusted_files.read_json(tmp_path / "a.json"), "`net`: a.json")
    with pytest.raises(NameError), untrusted_files.reading(tmp_path, "table"):
        untrusted_files.read_text(tmp_path)
    with pytest.raises(InputError, match="no table: AttributeError"), untrusted_files.reading(tmp_path, "table"):
        None.get("a")
