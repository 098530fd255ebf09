"""Runs work on external files in a child process that may only return a result.

A reader can't foresee what a file does to the libraries that read it. So a fork of this process reads it: with limits
on memory and time, without the right to write anywhere but in a folder of its own, to start programs or to open
connections. What becomes of it, a crash too, is one line here.
"""

import ctypes
import faulthandler
import os
import pickle
import resource
import select
import signal
import struct
import sys
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any, NoReturn, Self, TypeVar

from harness.common.error_text import is_own_fault, what_it_raised
from harness.common.errors import InputError, RunError
from harness.common.streams import flush

T = TypeVar("T")
Send = Callable[[T | None], None]
MB = 1 << 20
DIES_WITH_PARENT, NO_NEW_PRIVILEGES = 1, 38
"""Linux' PR_SET_PDEATHSIG and PR_SET_NO_NEW_PRIVS."""
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
"""Linux' system calls of Landlock, of the same numbers on all processors."""
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1, 2, 4, 8
RIGHTS_BY_VERSION = {1: 13, 2: 14, 3: 15}
"""How many rights over files each version of Landlock knows; later ones know more that matter little here."""
LONGEST_SILENCE = 5.0
"""So many times its processor time a fork may take by the clock: the machine may be busy, or the fork may wait."""
SENT, DONE, PLACE, MOST_SAID, FIRST_WITH_NET = "sent", "done", "\0place", 300, 4
SIGN_OF_LIFE_EVERY_S = 1.0
LARGE_BYTES = 1 << 16
ERRORS: dict[str, type[Exception]] = {one.__name__: one for one in (InputError, RunError, RuntimeError)}
_within: ContextVar[bool] = ContextVar("_within", default=False)


@dataclass(frozen=True)
class ProcessLimits:
    """What a fork may use: memory beyond what it begins with, processor time between two messages, size of a file.

    One that reads nothing external need not be confined: only its time is limited then.
    """

    memory_bytes: int = 1280 * MB
    cpu_s: int = 25
    file_bytes: int = MB
    confined: bool = True

    @classmethod
    def for_files(cls, files: Iterable[Path]) -> Self:
        """Return limits in proportion with what files take on the disk, however much they hold when unpacked."""
        told = [file.stat() for file in files if file.is_file()]
        # A file with holes is larger than what it takes.
        size = sum(min(each.st_size, 512 * each.st_blocks) for each in told)
        return cls(cls.memory_bytes + 12 * size, cls.cpu_s + 2 * (size // MB))


def isolated(work: Callable[[], T], place: str, limits: ProcessLimits = ProcessLimits()) -> T:
    """Return what work returns, such that ``pickle`` takes it, that is done in a fork without any rights.

    Raises:
        InputError: The work raises anything but these, crashes, or takes too much time or memory.
        RunError: The work raises it.
        RuntimeError: The work raises what is a fault of this program.
    """

    def once(send: Send[tuple[T]]) -> None:
        send((work(),))

    with closing(streamed(once, place, limits)) as answers:
        return next(answers)[0]


def streamed(
    work: Callable[[Send[T]], object], place: str, limits: ProcessLimits = ProcessLimits(), folders: Sequence[Path] = ()
) -> Generator[T]:
    """Yield what work sends that is done in a fork, as ``isolated`` does it; within a fork it is done there.

    Args:
        work: The work, called with the function that sends; None says that it goes on, and gives it no more time.
        place: What is read, for messages.
        folders: The folders beneath which it may write; it works in the first.

    Raises:
        InputError: See ``isolated``.
        RunError: See ``isolated``.
    """
    if _within.get():
        told: list[T | None] = []
        work(told.append)
        yield from (answer for answer in told if answer is not None)
        return
    flush(sys.stdout)
    flush(sys.stderr)
    reading, writing = os.pipe()
    owner, child = os.getpid(), os.fork()
    if not child:
        os.close(reading)
        _work(work, writing, limits, folders, owner)
    os.close(writing)
    with suppress(OSError):
        os.setpgid(child, child)
    try:
        while (answer := _next(reading, LONGEST_SILENCE * limits.cpu_s))[0] != DONE:
            kind, content = answer
            if kind != SENT:
                raise ERRORS[kind](content.replace(PLACE, place))
            if content is not None:
                yield content
    except TimeoutError:
        raise InputError(f"{place}: it took more than {limits.cpu_s} s; give a smaller or an undamaged file") from None
    except EOFError:
        status = os.waitpid(child, 0)[1]
        raise InputError(f"{place}: {_in_words(status, limits)}; give an undamaged file") from None
    finally:
        os.close(reading)
        # It is the first of a group of its own, which ends with it.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(child, signal.SIGKILL)
        with suppress(ChildProcessError):
            os.waitpid(child, 0)


def end_with_parent() -> None:
    """Let this process be killed when the one that started it ends, however that comes."""
    ctypes.CDLL(None).prctl(DIES_WITH_PARENT, signal.SIGKILL)


@contextmanager
def trusted() -> Iterator[None]:
    """Read in the block without forks: what this very process has written."""
    token = _within.set(True)
    try:
        yield
    finally:
        _within.reset(token)


def confine(folders: Sequence[Path]) -> bool:
    """Take from this thread, and what it starts, the right to write but in some folders; it can't be given back.

    It may neither start programs nor open connections from then on. Returns whether the kernel has done so: Linux since
    5.13, unless built or started without Landlock.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    version = libc.syscall(CREATE_RULESET, None, ctypes.c_size_t(0), ctypes.c_uint32(1))
    if version < 1:
        return False
    rights = (1 << RIGHTS_BY_VERSION.get(version, max(RIGHTS_BY_VERSION.values()))) - 1
    written = rights & ~(READ_FILE | READ_DIR | EXECUTE)
    net = 3 if version >= FIRST_WITH_NET else 0
    handled = struct.pack("QQ" if net else "Q", written | EXECUTE, *([net] if net else []))
    rules = libc.syscall(CREATE_RULESET, handled, ctypes.c_size_t(len(handled)), ctypes.c_uint32(0))
    of_files = written & (WRITE_FILE | 1 << RIGHTS_BY_VERSION[2])
    for path, allowed in ((Path(os.devnull), of_files), *((folder, written) for folder in folders)):
        opened = os.open(path, os.O_PATH)
        libc.syscall(ADD_RULE, rules, ctypes.c_uint32(1), struct.pack("=Qi", allowed, opened), ctypes.c_uint32(0))
        os.close(opened)
    libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    done = bool(libc.syscall(RESTRICT_SELF, rules, ctypes.c_uint32(0)) == 0)
    os.close(rules)
    return done


def _work(
    work: Callable[[Send[Any]], object], writing: int, limits: ProcessLimits, folders: Sequence[Path], owner: int
) -> NoReturn:
    """Do the work of a fork and end it, whatever comes."""
    try:
        os.setpgid(0, 0)
        end_with_parent()
        if os.getppid() != owner:
            os._exit(0)
        for end in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(end, signal.SIG_IGN)  # whoever waits for it ends it
        nowhere = os.open(os.devnull, os.O_RDWR)
        for descriptor in range(3):
            os.dup2(nowhere, descriptor)
        _within.set(True)
        faulthandler.disable()
        last_s = 0.0
        if limits.confined:
            _limit(limits, folders)

        def send(answer: object, kind: str = SENT) -> None:
            nonlocal last_s
            now_s = monotonic()
            if answer is None and kind == SENT and now_s - last_s < SIGN_OF_LIFE_EVERY_S:
                return
            last_s = now_s
            # Large arrays go as they are, without a copy in between; small ones are copied sooner than written alone.
            arrays: list[pickle.PickleBuffer] = []

            def is_small(array: pickle.PickleBuffer) -> bool:
                if array.raw().nbytes >= LARGE_BYTES:
                    arrays.append(array)
                return array.raw().nbytes < LARGE_BYTES

            parts = [memoryview(pickle.dumps((kind, answer), protocol=5, buffer_callback=is_small))]
            parts += [array.raw() for array in arrays]
            lengths = [len(part) for part in parts]
            frames: tuple[bytes | memoryview, ...] = (struct.pack(f"Q{len(parts)}Q", len(parts), *lengths), *parts)
            for part in frames:
                left = memoryview(part)
                while left:
                    left = left[os.write(writing, left) :]
            if answer is not None:
                _renew_cpu(limits)

        try:
            work(send)
            send(None, DONE)
        except Exception as error:
            send(*_told_of(error, limits))
    finally:
        os._exit(0)


def _told_of(error: Exception, limits: ProcessLimits) -> tuple[str, str]:
    """Return what a fork tells of an exception, and which error it becomes."""
    match error:
        case RunError():
            return str(error), "RunError"
        case InputError() if "std::bad_alloc" not in str(error):
            return str(error), "InputError"
        case InputError() | MemoryError():
            why = f"{_too_much_memory(limits)}; give a smaller file, or"
        case RecursionError():
            why = "it is nested too deeply;"
        case _ if is_own_fault(error):
            return what_it_raised(error), "RuntimeError"
        case _:
            why = f"can't be read: {what_it_raised(error)[:MOST_SAID]};"
    return f"{PLACE}: {why} give an undamaged file", "InputError"


def _limit(limits: ProcessLimits, folders: Sequence[Path]) -> None:
    with open("/proc/self/statm", encoding="ascii") as told:
        begins_with = int(told.read().split()[5]) * resource.getpagesize()
    most = {
        resource.RLIMIT_DATA: begins_with + limits.memory_bytes,
        resource.RLIMIT_FSIZE: limits.file_bytes if folders else 0,
        resource.RLIMIT_CORE: 0,
    }
    for kind, value in most.items():
        hard = resource.getrlimit(kind)[1]
        least = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(kind, (least, least))
    _renew_cpu(limits)
    if folders:
        os.chdir(folders[0])
        tempfile.tempdir = str(folders[0])
    if caching := sys.modules.get("numba.core.caching"):
        caching.Cache.save_overload = lambda *_: None  # nothing compiled here is kept
    confine(folders)


def _renew_cpu(limits: ProcessLimits) -> None:
    used = resource.getrusage(resource.RUSAGE_SELF)
    resource.setrlimit(
        resource.RLIMIT_CPU,
        (int(used.ru_utime + used.ru_stime) + 1 + limits.cpu_s, resource.getrlimit(resource.RLIMIT_CPU)[1]),
    )


def _next(reading: int, patience_s: float) -> tuple[str, Any]:
    """Return the next message of a fork, or raise ``TimeoutError``, or ``EOFError`` where nothing will come."""
    (count,) = struct.unpack("Q", _read(reading, 8, patience_s))
    lengths = struct.unpack(f"{count}Q", _read(reading, 8 * count, patience_s))
    content, *arrays = (_read(reading, length, patience_s) for length in lengths)
    answer: tuple[str, Any] = pickle.loads(content, buffers=arrays)
    return answer


def _read(reading: int, length: int, patience_s: float) -> bytearray:
    content, waiting = bytearray(length), select.poll()
    waiting.register(reading, select.POLLIN)
    left = memoryview(content)
    while left:
        if not waiting.poll(1000.0 * patience_s):
            raise TimeoutError
        if not (came := os.readv(reading, [left])):
            raise EOFError
        left = left[came:]
    return content


def _in_words(status: int, limits: ProcessLimits) -> str:
    """Return how a fork ended that did not say so."""
    code = -os.waitstatus_to_exitcode(status)
    if code == signal.SIGXCPU:
        return f"it took more than {limits.cpu_s} s"
    name = signal.Signals(code).name if code in set(signal.Signals) else f"exit code {-code}"
    return f"the program crashed while reading it ({name}), or {_too_much_memory(limits)}"


def _too_much_memory(limits: ProcessLimits) -> str:
    return f"it needs more than {limits.memory_bytes / (1024 * MB):.2f} GB of memory"
