"""A tracker that is a program in any language: scans go to its stdin as lines, tracks come back on stdout.

All numbers are separated by blanks; ``nan`` is what is not measured, ``inf`` what has no end. The harness writes first

    protocol 1
    frame road|plane                        in the plane lon is x, lat is y, headings count from the x axis
    step_s S
    seed N
    sensor.NAME VALUE                       a line for each figure of the data sheet
    lane NUMBER RIGHT LEFT START END        on a road: a line for each lane, metres
    lane NUMBER WIDTH X Y X Y ...           in the plane, where there is a map: its middle line
    option NAME VALUE                       a line for each of ``tracker.options``
    end

and the program answers ``ready``; it skips lines that it does not know. Then, for the k-th scan, of d detections,

    scan K TIME D
    ego LON LAT HEADING SPEED LENGTH WIDTH
    LON LAT SPEED STD_LON STD_LAT STD_SPEED LENGTH WIDTH STD_LENGTH STD_WIDTH HEADING STD_HEADING FLIP CORRELATION
    free N R1 ... RN                        ``Scan.free_space``, N is 0 if the sensor does not tell
    signals N S1 ... SN                     1 open, 0 closed; N is 0 if the tracker is not told

with d lines of the third kind, which end with ``SCORE CLASS`` where the detector gives either (CLASS counts in
``mmpf.scan.VEHICLE_CLASSES``), and the program answers with its m tracks

    tracks K M
    ID LON LAT SPEED LAT_SPEED ACCEL STD_LON STD_LAT STD_SPEED EXISTENCE tentative|confirmed|hidden

It must flush what it wrote. In place of any answer, ``error WORDS`` ends the run with these words. Each episode starts
the program anew; at its end stdin is closed, and a program that has not ended a second later is killed.
"""

import json
import os
import select
import shlex
import signal
import subprocess
import weakref
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import fields
from time import monotonic

import numpy as np

from harness.common.errors import InputError, RunError
from harness.trackers.plane import is_in_plane
from harness.trackers.protocol import TrackerSetting
from mmpf.scan import BodyHeadings, BodySizes, Detections, Scan, check_scan
from mmpf.tracks import TRACK_STATES, Tracks

PREFIX = "exec:"
TIME_LIMITS_S = {"start_timeout_s": 30.0, "step_timeout_s": 10.0}
"""Options that the harness keeps to itself: seconds for ``ready`` and for the tracks of a scan."""
MOST_ANSWER_BYTES, MOST_STDERR_BYTES, CHUNK_BYTES = 16_000_000, 4_000, 65_536
ENDS_WITHIN_S = 1.0
TRACK_WORDS = len(fields(Tracks))
_MEASURED = tuple(column.name for column in fields(Detections)[:6])
_MORE = "score", "vehicle_class"


class ProgramTracker:
    """Hands scans to a program and its tracks back.

    Raises:
        InputError: The program can't be started, or does not answer the setting as it should.
    """

    def __init__(self, name: str, setting: TrackerSetting, options: Mapping[str, object]) -> None:
        """Start the program of ``exec:`` and a shell's command, and tell it the setting."""
        limits = {key: _seconds(key, options.get(key, default)) for key, default in TIME_LIMITS_S.items()}
        own = {key: value for key, value in options.items() if key not in limits}
        self._step_s, self._program = limits["step_timeout_s"], _Program(name)
        self._time_s: float | None = None
        self._scans = 0
        try:
            answer = self._program.ask("".join(setting_lines(setting, own)), limits["start_timeout_s"])
        except RunError as error:
            raise InputError(f"`tracker` {error}; fix the program") from None
        if answer != [["ready"]]:
            raise InputError(f"`tracker` {name}: it answered {_shown(answer[0])} to the setting, not ready")

    def step(self, scan: Scan) -> Tracks:
        """Hand over one scan and return the program's tracks.

        Raises:
            InvalidScanError: See ``mmpf.scan.check_scan``; the program never sees such a scan.
            RunError: The program ended, took too long or answered what is no tracks.
        """
        check_scan(scan, self._time_s)
        self._time_s, self._scans = scan.time_s, self._scans + 1
        try:
            return _tracks_of(self._program.ask(scan_text(scan, self._scans), self._step_s), self._scans)
        except (RunError, ValueError) as error:
            told = str(error) if isinstance(error, RunError) else f"{self._program.name}: it answered {error}"
            raise RunError(f"at {scan.time_s:g} s {told}") from None


def _seconds(name: str, value: object) -> float:
    if isinstance(value, int | float) and 0.0 < value < 1e6:
        return float(value)
    raise InputError(f"`tracker.options.{name}` {value}: give seconds above 0, for example 10")


def setting_lines(setting: TrackerSetting, options: Mapping[str, object]) -> Iterator[str]:
    """Yield the lines that a program receives before the first scan."""
    road = setting.road
    yield f"protocol 1\nframe {'plane' if is_in_plane(setting) else 'road'}\nstep_s {setting.step_s!r}\n"
    yield f"seed {setting.rng.integers(2**31)}\n"
    for column in fields(setting.sensor):
        yield f"sensor.{column.name} {float(getattr(setting.sensor, column.name))!r}\n"
    for lane in road.lanes:
        yield f"lane {lane.number} {_numbers([lane.right_m, lane.left_m, lane.start_m, lane.end_m])}\n"
    for number, line in enumerate(road.lines(), start=1):
        yield f"lane {number} {_numbers([line.width_m, *line.xy.ravel().tolist()])}\n"
    for name, value in options.items():
        text = value if isinstance(value, str) else json.dumps(value)
        yield f"option {name} {' '.join(text.splitlines())}\n"
    yield "end\n"


def scan_text(scan: Scan, number: int) -> str:
    """Return a scan, the so manieth, as the lines that a program reads."""
    found, unknown = scan.detections, np.full(len(scan.detections), np.nan)
    # A program that reads fourteen numbers of each detection goes on doing so where there are no more.
    more = ("correlation", *_MORE) if found.score is not None or found.vehicle_class is not None else ("correlation",)
    groups = ((found, _MEASURED), (found.sizes, BodySizes), (found.headings, BodyHeadings), (found, more))
    columns = []
    for part, kind in groups:
        names = kind if isinstance(kind, tuple) else tuple(column.name for column in fields(kind))
        values = (None if part is None else getattr(part, name) for name in names)
        columns += [unknown if each is None else each for each in values]
    ego = [float(getattr(scan.ego, column.name)) for column in fields(scan.ego)]
    free = [] if scan.free_space is None else scan.free_space.range_m.tolist()
    signals = [] if scan.open_signals is None else scan.open_signals.astype(int).tolist()
    lines = [f"scan {number} {float(scan.time_s)!r} {len(found)}", f"ego {_numbers(ego)}"]
    lines += [_numbers(row) for row in np.column_stack(columns).tolist()]
    lines += [f"{name} {_numbers([len(values), *values])}" for name, values in (("free", free), ("signals", signals))]
    return "\n".join(lines) + "\n"


def _numbers(values: list[float]) -> str:
    return " ".join(map(repr, values))


def _tracks_of(answer: list[list[str]], scan: int) -> Tracks:
    """Return the tracks in the answer to a scan; raise ValueError if it is something else."""
    if answer[0][:2] != ["tracks", str(scan)]:
        raise ValueError(f"{_shown(answer[0])}, not tracks {scan} and how many")
    rows = answer[1:]
    for row in rows:
        text = "".join(row)  # Python alone takes ``1_0`` or other scripts' digits
        if len(row) != TRACK_WORDS or row[-1] not in TRACK_STATES or "_" in text or not text.isascii():
            raise ValueError(f"{_shown(row)}, not the {TRACK_WORDS} words of a track, in ASCII without _")
    try:
        track_id = np.array([int(row[0]) for row in rows], dtype=np.int64)
        numbers = np.array([[float(word) for word in row[1:-1]] for row in rows]).reshape(len(rows), TRACK_WORDS - 2)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"a track that is not made of numbers ({error})") from None
    state = np.array([TRACK_STATES.index(row[-1]) for row in rows], dtype=np.int8)
    names = (column.name for column in fields(Tracks)[1:-1])
    return Tracks(track_id=track_id, state=state, **dict(zip(names, np.ascontiguousarray(numbers.T), strict=True)))


def _shown(words: list[str]) -> str:
    text = " ".join(words)
    return repr(text if len(text) <= 60 else f"{text[:57]}...")


class _Program:
    """A running program, its pipes, and its output that has not been read yet."""

    def __init__(self, name: str) -> None:
        self.name = name
        try:
            command = shlex.split(name.removeprefix(PREFIX))
            if not command:
                raise ValueError("no program is named")
            self._process = subprocess.Popen(command, stdin=-1, stdout=-1, stderr=-1, bufsize=0, start_new_session=True)
        except (OSError, ValueError) as error:
            problem = error.strerror if isinstance(error, OSError) else str(error)
            raise InputError(f"`tracker` {name}: it can't be started ({problem}); for example exec:./tracker") from None
        pipes = self._process.stdin, self._process.stdout, self._process.stderr
        self._in, self._out, self._err = (pipe.fileno() for pipe in pipes if pipe is not None)
        for pipe in (self._in, self._out, self._err):
            os.set_blocking(pipe, False)
        self._read, self._stderr = bytearray(), bytearray()
        weakref.finalize(self, _end, self._process)

    def ask(self, text: str, limit_s: float) -> list[list[str]]:
        """Write lines and return the answer's, word by word; a ``RunError`` where none comes."""
        for pipe in (self._out, self._err):
            self._receive_from(pipe)
        if self._read:
            raise RunError(f"{self.name}: it wrote {_shown(self._read.decode(errors='replace').split())} unasked")
        rest, deadline = memoryview(text.encode()), monotonic() + limit_s
        poll, open_pipes = select.poll(), {self._out, self._err}
        for pipe in open_pipes:
            poll.register(pipe, select.POLLIN)
        poll.register(self._in, select.POLLOUT)
        while (answer := self._answer()) is None:
            if self._out not in open_pipes:
                raise RunError(f"{self.name}: {self._how_it_ended()}")
            left_s = deadline - monotonic()
            ready = dict(poll.poll(1e3 * left_s)) if left_s > 0.0 else {}
            if not ready:
                told = "did not read what it was sent" if rest else "did not answer"
                raise RunError(f"{self.name}: it {told} within {limit_s:g} s{self._last_words()}")
            if self._in in ready:
                try:
                    rest = rest[os.write(self._in, rest[:CHUNK_BYTES]) :]
                except BrokenPipeError:
                    rest = rest[:0]  # whether it has ended, or answers all the same, its stdout tells
                if not rest:
                    poll.unregister(self._in)
            for pipe in open_pipes & ready.keys():
                if not self._receive_from(pipe):
                    open_pipes.discard(pipe)
                    poll.unregister(pipe)
        if answer[0][0] == "error":
            raise RunError(f"{self.name}: it says {' '.join(answer[0][1:])!r}{self._last_words()}")
        return answer

    def _answer(self) -> list[list[str]] | None:
        """Take the next complete answer from the buffer as lines of words; None while it is incomplete."""
        if len(self._read) > MOST_ANSWER_BYTES:
            raise RunError(f"{self.name}: it answered more than {MOST_ANSWER_BYTES // 1_000_000} MB")
        end = self._read.find(b"\n")
        if end < 0:
            return None
        words = self._read[:end].decode(errors="replace").split() or [""]
        count = 0
        if words[0] == "tracks":
            if len(words) != 3 or not words[2].encode().isdigit() or len(words[2]) > 6:
                raise RunError(f"{self.name}: it answered {_shown(words)}, not tracks, the scan and how many")
            count = int(words[2])
        if self._read.count(b"\n") <= count:
            return None
        lines = self._read.split(b"\n", count + 1)
        self._read = lines[-1]
        return [words, *(line.decode(errors="replace").split() for line in lines[1:-1])]

    def _receive_from(self, pipe: int) -> bool:
        """Read what there is; return whether more may come."""
        try:
            read = os.read(pipe, CHUNK_BYTES)
        except BlockingIOError:
            return True
        if pipe == self._out:
            self._read += read
        else:
            self._stderr = (self._stderr + read)[-MOST_STDERR_BYTES:]
        return bool(read)

    def _how_it_ended(self) -> str:
        try:
            code = self._process.wait(0.5)
        except subprocess.TimeoutExpired:
            return f"it closed its stdout{self._last_words()}"
        by = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
        return f"it {by}{self._last_words()}"

    def _last_words(self) -> str:
        """Return the end of what it wrote on stderr, to follow what happened."""
        for _ in range(64):  # one that never stops writing is not heard to its end
            before = bytes(self._stderr)
            if not self._receive_from(self._err) or self._stderr == before:
                break
        lines = [" ".join(line.split()) for line in self._stderr.decode(errors="replace").splitlines() if line.strip()]
        return f"; stderr: {' | '.join(lines[-3:])[-300:]}" if lines else ""


def _end(process: subprocess.Popen[bytes]) -> None:
    """Close a program's stdin, give it time to end, and kill it and what it started."""
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe is not None:
            pipe.close()
    with suppress(subprocess.TimeoutExpired):
        process.wait(ENDS_WITHIN_S)
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
