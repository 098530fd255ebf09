"""Trackers that are programs: the protocol, the examples, and programs that misbehave."""

import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.common.errors import InputError, RunError
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.storage import run_folder as runfolder
from harness.trackers.catalogue import build_tracker
from harness.trackers.conformance.checks import check_tracker
from harness.trackers.conformance.scripted_scenes import ROAD, SENSOR, busy_scene
from harness.trackers.program import scan_text
from harness.trackers.protocol import TrackerSetting
from mmpf.scan import TRUCK, InvalidScanError
from mmpf.tracks import Tracks
from tests.harness.stand_ins import SteadyTraffic, observing

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
PYTHON_EXAMPLE = f"exec:{shlex.quote(sys.executable)} {shlex.quote(str(EXAMPLES / 'exec_tracker.py'))}"

# It answers four scans with nothing; what it does at the fifth is a test's own.
WELL_BEHAVED = """
import os, sys, time
for line in sys.stdin:
    if line == "end\\n":
        break
def say(text):
    print(text, flush=True)
{before}
say("ready")
scans = 0
while line := sys.stdin.readline():
    if not line.startswith("scan"):
        continue
    for _ in range(int(line.split()[3]) + 3):
        sys.stdin.readline()
    scans += 1
    if scans == 5:
        {at_fifth}
    say(f"tracks {{scans}} 0")
"""
TRACK = "1 2 3 4 0 0 1 1 1 1 confirmed"
AT_FIFTH = {
    "ends": ("sys.exit(0)", "ended with exit code 0"),
    "ends with a code": ("sys.exit(7)", "ended with exit code 7"),
    "raises": ("raise RuntimeError('the queue broke')", "the queue broke"),
    "is killed": ("os.kill(os.getpid(), 9)", "SIGKILL"),
    "aborts": ("os.abort()", "SIGABRT"),
    "hangs": ("time.sleep(60)", "did not answer within 0.5 s"),
    "hangs in the middle of an answer": (rf"say('tracks 5 2\n{TRACK}'); time.sleep(60)", "did not answer within"),
    "writes on stderr for ever": ("[sys.stderr.write('no! ' * 999) for _ in iter(int, 1)]", "did not answer within"),
    "writes on stdout for ever": ("[sys.stdout.write('9' * 99999) for _ in iter(int, 1)]", "more than 16 MB"),
    "closes its stdout": ("os.close(1); time.sleep(60)", "closed its stdout"),
    "closes its stdin and ends": ("os.close(0); sys.exit(3)", "exit code 3"),
    "answers something else": (r"say('hello'); continue", "'hello', not tracks"),
    "answers a blank line": (r"say(''); continue", "not tracks"),
    "answers bytes that are no text": (r"os.write(1, b'\xff\xfe\n'); continue", "not tracks"),
    "counts no tracks": (r"say('tracks 5 many'); continue", "not tracks, the scan and how many"),
    "counts less than none": (r"say('tracks 5 -1'); continue", "not tracks, the scan and how many"),
    "has a word too few": (r"say('tracks 5 1\n1 2 3 confirmed'); continue", "not the 11 words of a track"),
    "has an unknown state": (rf"say('tracks 5 1\n{TRACK[:-9]}sure'); continue", "not the 11 words of a track"),
    "has a word for a number": (rf"say('tracks 5 1\n{TRACK.replace('2', 'two')}'); continue", "not made of numbers"),
    "has Python's digits": (rf"say('tracks 5 1\n{TRACK.replace('2', '2_0')}'); continue", "in ASCII without _"),
    "counts in another script": (r"say('tracks 5 \u0661'); continue", "not tracks, the scan and how many"),
    "has a place that is nan": (rf"say('tracks 5 1\n{TRACK.replace('2', 'nan')}'); continue", "holds nan"),
    "has an identity twice": (rf"say('tracks 5 2\n{TRACK}\n{TRACK}'); continue", "two tracks have one identity"),
    "answers another scan": (r"say('tracks 4 0'); continue", "'tracks 4 0', not tracks 5 and how many"),
    "says what is wrong": (r"say('error no licence left'); continue", "it says 'no licence left'"),
}  # fmt: skip
QUICK = ("ends", "raises", "is killed", "hangs", "closes its stdout", "answers something else", "has an identity twice")
AT_START = {
    "refuses an option": ("say('error no option gain'); sys.exit()", "it says 'no option gain'"),
    "greets": ("say('hello, world')", "answered 'hello, world' to the setting, not ready"),
    "never is ready": ("time.sleep(60)", "did not answer within 0.5 s"),
    "ends at once": ("sys.exit(4)", "ended with exit code 4"),
    "answers before it is asked": ("say('tracks 1 0')", "answered 'tracks 1 0' to the setting"),
}


def program(folder: Path, before: str = "", at_fifth: str = "pass") -> str:
    """Write a program that misbehaves in one way, and return its name as a tracker."""
    path = folder / "tracker.py"
    path.write_text(WELL_BEHAVED.format(before=before, at_fifth=at_fifth))
    return f"exec:{shlex.quote(sys.executable)} {shlex.quote(str(path))}"


def run_with(name: str, out: Path, *settings: str, traffic: SteadyTraffic | None = None):
    limits = [f"tracker.options.{which}_timeout_s={0.5 if which == 'step' else 5}" for which in ("start", "step")]
    config = resolve_run_config(options={"tracker": name}, settings=[*limits, *settings])
    return run(config, out=out, open_snapshots=observing(traffic or SteadyTraffic(steps=8)))


@pytest.mark.parametrize("way", [pytest.param(way, marks=() if way in QUICK else pytest.mark.slow) for way in AT_FIFTH])
def test_a_program_that_misbehaves_ends_the_run_in_one_line_and_keeps_the_steps_before(way, tmp_path):
    at_fifth, told = AT_FIFTH[way]
    patient = () if "answer within" in told else ("tracker.options.step_timeout_s=5",)
    with pytest.raises(RunError) as raised:
        run_with(program(tmp_path, at_fifth=at_fifth), tmp_path / "run", *patient)
    message = str(raised.value)
    assert "failed after 4 steps" in message
    assert told in message
    assert "\n" not in message
    assert len(message) < 1000
    kept = pd.read_parquet(tmp_path / f"run{runfolder.INCOMPLETE_SUFFIX}" / runfolder.TRUTH)
    assert kept["step"].nunique() == 4


@pytest.mark.parametrize("way", AT_START)
def test_a_program_that_does_not_get_ready_is_wrong_input(way, tmp_path):
    before, told = AT_START[way]
    name = program(tmp_path, before=before)
    with pytest.raises(InputError, match="`tracker` exec:") as raised:
        run_with(name, tmp_path / "run", "tracker.options.start_timeout_s=0.5")
    assert told in str(raised.value)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("exec:", "no program is named"),
        ("exec:./nosuch", "No such file or directory"),
        ("exec:'./a", "No closing quotation"),
        ("exec:/etc/passwd", "Permission denied"),
    ],
)
def test_a_program_that_cannot_be_started_is_wrong_input(name, told):
    with pytest.raises(InputError, match=told):
        build_tracker(name, setting(), {})


def test_a_program_that_fails_in_a_later_episode_keeps_the_earlier_ones(tmp_path):
    # The check and the rehearsal start it too; a file counts.
    file = str(tmp_path / "starts")
    count = f"open({file!r}, 'a').write('x')\nif os.path.getsize({file!r}) > 3:\n    sys.exit(9)"
    with pytest.raises(RunError, match=r"failed after 3 steps: .*exit code 9"):
        run_with(program(tmp_path, before=count), tmp_path / "run", traffic=SteadyTraffic(steps=8, ego_stay=3))


def test_a_program_that_does_not_end_is_killed_with_what_it_started(tmp_path):
    child = "import subprocess; child = subprocess.Popen(['sleep', '60'])"
    pid = f"open({str(tmp_path / 'pid')!r}, 'w').write(str(child.pid))"
    tracker = build_tracker(program(tmp_path, before=f"{child}; {pid}"), setting(), {})
    number = int((tmp_path / "pid").read_text())
    del tracker
    for _ in range(50):
        status = Path(f"/proc/{number}/stat")
        if not status.exists() or status.read_text().split()[2] == "Z":
            return
        time.sleep(0.05)
    pytest.fail("the child of the program lives on")


def setting() -> TrackerSetting:
    return TrackerSetting(ROAD, SENSOR, np.random.default_rng(0))


def followed(name: str, options: dict[str, object] | None = None) -> list[Tracks]:
    tracker = build_tracker(name, setting(), options or {})
    return [tracker.step(labelled.scan) for labelled in busy_scene()]


@pytest.mark.slow
def test_the_example_in_python_passes_the_suite():
    check_tracker(lambda setting, options: build_tracker(PYTHON_EXAMPLE, setting, options))


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="there is no C++ compiler")
def test_the_example_in_cpp_reports_the_tracks_of_the_one_in_python(tmp_path):
    command = ["g++", "-std=c++17", str(EXAMPLES / "exec_tracker.cpp"), "-o", str(tmp_path / "tracker")]
    subprocess.run(command, check=True)
    for options in ({}, {"gain": 0.3}):
        pairs = zip(followed(PYTHON_EXAMPLE, options), followed(f"exec:{tmp_path / 'tracker'}", options), strict=True)
        for ours, theirs in pairs:
            for column, values in vars(ours).items():
                np.testing.assert_allclose(values, getattr(theirs, column), rtol=1e-12)


def test_a_program_reads_the_numbers_that_a_tracker_gets():
    scan = busy_scene()[10].scan
    first, ego, *rows, free, signals = scan_text(scan, 11).splitlines()
    assert first.split() == ["scan", "11", repr(scan.time_s), str(len(scan.detections))]
    assert [float(word) for word in ego.split()[1:]] == list(vars(scan.ego).values())
    table = np.array([[float(word) for word in row.split()] for row in rows])
    assert table.shape == (len(scan.detections), 14)
    assert (table[:, 0] == scan.detections.lon_m).all()
    assert (table[:, 4] == scan.detections.std_lat_m).all()
    assert (free, signals) == ("free 0", "signals 0")
    told = replace(scan.detections, vehicle_class=np.full(len(scan.detections), TRUCK))
    rows = scan_text(replace(scan, detections=told), 11).splitlines()[2:-2]
    assert {tuple(row.split()[14:]) for row in rows} == {("nan", f"{float(TRUCK)}")}


def test_an_answer_too_many_is_found_out(tmp_path):
    twice = "say('tracks 5 0'); say('tracks 5 0'); continue"
    with pytest.raises(RunError, match=r"failed after 5 steps: .*'tracks 5 0'"):
        run_with(program(tmp_path, at_fifth=twice), tmp_path / "run")


def test_an_impossible_scan_is_refused_before_the_program_sees_it():
    tracker = build_tracker(PYTHON_EXAMPLE, setting(), {})
    scan = busy_scene()[0].scan
    tracker.step(scan)
    with pytest.raises(InvalidScanError):
        tracker.step(scan)
