"""Whole runs on stand-in traffic, and a few on SUMO."""

import errno
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import NoReturn

import pandas as pd
import pytest

from harness.commands.app import run_command_line
from harness.common.errors import InputError, RunError, RunInterruptedError
from harness.common.files import replacing
from harness.config.model import RunConfig
from harness.report.page import write_run_page
from harness.report.pictures import draw_figures
from harness.running.replay import read_snapshots
from harness.running.resolve import resolve_run_config
from harness.running.run import Drawing, FinishedRun, run
from harness.running.snapshots import SnapshotStream
from harness.storage import run_folder as runfolder
from tests.harness.stand_ins import EchoTracker, SteadyTraffic, observing

ECHO = "tests.harness.stand_ins:echo_tracker"
DRAWING = Drawing(draw_figures, write_run_page)
TABLES = (runfolder.TRUTH, runfolder.DETECTIONS, runfolder.TRACKS, runfolder.ERRORS)


@pytest.fixture
def steady_traffic() -> SteadyTraffic:
    return SteadyTraffic(steps=12)


def run_on(traffic: SteadyTraffic, config: RunConfig, out: Path, **options: object) -> FinishedRun:
    """Run with stand-in traffic in SUMO's place; no figures are drawn, which take longer than the run."""
    return run(config, out=out, open_snapshots=observing(traffic), **options)


def configured(**options: object) -> RunConfig:
    return resolve_run_config(options={"tracker": ECHO, **options})


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """Return the folder of a run that no test may change."""
    return run_on(SteadyTraffic(steps=12), configured(), tmp_path_factory.mktemp("finished") / "run").folder


@pytest.mark.slow
def test_a_run_leaves_every_file(steady_traffic, tmp_path):
    finished = run_on(steady_traffic, configured(), tmp_path / "run", command="harness run", draw=DRAWING)
    names = {entry.name for entry in finished.folder.iterdir()}
    assert {
        "config.toml", "manifest.json", "truth.parquet", "detections.parquet", "tracks.parquet", "errors.parquet",
        "metrics.json", "figures", "report.html",
    } <= names  # fmt: skip
    assert "diagnostics.parquet" not in names, "the stand-in tracker tells nothing of its inside"
    assert json.loads((finished.folder / "metrics.json").read_text()) == finished.metrics
    assert json.loads((finished.folder / "manifest.json").read_text())["status"] == "complete"
    assert resolve_run_config(finished.folder / "config.toml", options={"tracker": ECHO}) == configured()
    assert steady_traffic.closed


@pytest.mark.parametrize("profile", ["lidar", "radar"])
def test_a_replay_gives_the_tracker_the_very_same_scans(steady_traffic, tmp_path, monkeypatch, profile):
    scans: list[list] = [[], []]

    def listener(heard: list):
        class Listener(EchoTracker):
            def step(self, scan):
                heard.append(scan)
                return super().step(scan)

        return lambda setting, options: Listener(setting)

    monkeypatch.setattr("tests.harness.stand_ins.echo_tracker", listener(scans[0]))
    first = run_on(steady_traffic, configured(sensor=profile), tmp_path / "first").folder
    monkeypatch.setattr("tests.harness.stand_ins.echo_tracker", listener(scans[1]))
    run(resolve_run_config(options={"replay": str(first), "tracker": ECHO}), out=tmp_path / "again")
    assert len(scans[0]) == len(scans[1]) > 12
    for live, replayed in zip(*scans, strict=True):
        assert (live.time_s, live.ego) == (replayed.time_s, replayed.ego)
        assert live.free_space.range_m.tobytes() == replayed.free_space.range_m.tobytes()
        for name in ("lon_m", "lat_m", "std_lon_m", "std_lat_m", "speed_mps", "std_speed_mps"):
            assert getattr(live.detections, name).tobytes() == getattr(replayed.detections, name).tobytes()
        sizes = [scan.detections.sizes for scan in (live, replayed)]
        assert [one is None for one in sizes] == [profile == "radar"] * 2
        for name in ("length_m", "width_m", "std_length_m", "std_width_m") if sizes[0] else ():
            assert getattr(sizes[0], name).tobytes() == getattr(sizes[1], name).tobytes()


@pytest.mark.parametrize("option", [{"net": "other"}, {"density": 33.0}, {"duration": 1.0}, {"sensor": "radar"}])
def test_a_replay_refuses_other_traffic_or_another_sensor(finished, option):
    with pytest.raises(InputError, match=f"`{next(iter(option))}`.*recording"):
        resolve_run_config(options={"replay": str(finished), **option})


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        (("sensor.range_m=1.0",), "range"),
        (("sensor.detection_probability=0.0", "sensor.clutter_per_scan=0.0"), "detected"),
    ],
)
def test_a_run_that_sees_nobody_is_refused_with_the_reason_and_leaves_nothing(settings, reason, tmp_path):
    config = resolve_run_config(options={"tracker": ECHO}, settings=settings)
    with pytest.raises(InputError, match=f"nothing can be scored.*{reason}"):
        run_on(SteadyTraffic(steps=8), config, tmp_path / "run")
    assert not list(tmp_path.iterdir())


def test_a_failure_keeps_the_finished_steps_and_says_so(steady_traffic, tmp_path):
    steady_traffic.fail_at = 7
    with pytest.raises(RunError, match=r"after 7 steps.*the traffic broke"):
        run_on(steady_traffic, configured(), tmp_path / "run")
    folder = tmp_path / "run.incomplete"
    assert pd.read_parquet(folder / "truth.parquet")["step"].max() == 6
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["status"] == "failed"
    assert "the traffic broke" in manifest["problem"]
    assert steady_traffic.closed


@pytest.mark.parametrize("compiled", [False, True])
def test_an_interrupt_keeps_the_finished_steps_and_says_so(compiled, steady_traffic, tmp_path, monkeypatch):
    class Interrupted(EchoTracker):
        def step(self, scan):
            if scan.time_s > 0.45 and compiled:  # as compiled code reports it
                raise SystemError("a result with an exception set") from KeyboardInterrupt()
            if scan.time_s > 0.45:
                raise KeyboardInterrupt
            return super().step(scan)

    monkeypatch.setattr("tests.harness.stand_ins.echo_tracker", lambda setting, options: Interrupted(setting))
    with pytest.raises(RunInterruptedError, match="after 5 steps"):
        run_on(steady_traffic, configured(), tmp_path / "run")
    folder = tmp_path / "run.incomplete"
    assert json.loads((folder / "manifest.json").read_text())["status"] == "interrupted"
    assert pd.read_parquet(folder / "tracks.parquet")["step"].max() == 4
    assert len(list(read_snapshots(folder, configured()))) == 5


@pytest.mark.slow
def test_a_resumed_run_keeps_a_finished_one_that_is_the_same_and_refuses_another(steady_traffic, tmp_path, capsys):
    out, untouched = tmp_path / "run", SteadyTraffic(steps=12)
    made = run_on(steady_traffic, configured(), out, resume=True)
    before = {path: path.stat().st_mtime_ns for path in out.iterdir()}
    kept = run_on(untouched, configured(), out, resume=True, quiet=False)
    assert (kept.folder, kept.metrics) == (made.folder, made.metrics)
    assert "the 12 steps in" in capsys.readouterr().err
    with pytest.raises(InputError, match="seed 0 there, 7 now"):
        run_on(untouched, configured(seed=7), out, resume=True)
    near = resolve_run_config(settings=["sensor.range_m=40"], options={"tracker": ECHO})
    run_on(steady_traffic, near, tmp_path / "near")
    with pytest.raises(InputError, match="range_m 40 there, None now"):
        run_on(untouched, configured(), tmp_path / "near", resume=True)
    manifest = json.loads((out / "manifest.json").read_text())
    for code, told in ((manifest["code_sha256"] | {"mmpf": "0" * 64}, "mmpf has changed"), ([1], "missing or broken")):
        (out / "manifest.json").write_text(json.dumps(manifest | {"code_sha256": code}))
        with pytest.raises(InputError, match=told):
            run_on(untouched, configured(), out, resume=True)
    (out / "manifest.json").write_text(json.dumps(manifest | {"is_log": True}))
    with pytest.raises(InputError, match="the tracks there are a log's"):
        run_on(untouched, configured(), out, resume=True)
    del manifest["steps"]
    (out / "manifest.json").write_text(json.dumps(manifest))
    assert run_on(untouched, configured(), out, resume=True).metrics == made.metrics
    assert {path for path in out.iterdir() if before[path] != path.stat().st_mtime_ns} == {out / "manifest.json"}
    out.rename(tmp_path / "next.incomplete")
    run_on(SteadyTraffic(steps=12), configured(), tmp_path / "next", resume=True, quiet=False)
    assert "can't be continued and stay there" in capsys.readouterr().err


def test_a_resumed_run_refuses_traffic_whose_file_has_changed(tmp_path):
    file, out = tmp_path / "traffic.csv", tmp_path / "run"

    def open_snapshots(config: RunConfig) -> SnapshotStream:
        return replace(observing(SteadyTraffic(steps=12))(config), files={"replay/traffic.csv": file})

    file.write_text("as recorded")
    run(configured(), out=out, open_snapshots=open_snapshots)
    run(configured(), out=out, open_snapshots=open_snapshots, resume=True)
    file.write_text("edited since")
    with pytest.raises(InputError, match=r"traffic\.csv has changed"):
        run(configured(), out=out, open_snapshots=open_snapshots, resume=True)


def no_room(*_: object) -> NoReturn:
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.slow
@pytest.mark.parametrize("broken", [0, 1])
def test_a_run_whose_pictures_find_no_room_is_complete_and_says_how_to_draw_it(broken, steady_traffic, tmp_path):
    draw = Drawing(*(no_room if place == broken else print for place in range(2)))
    with pytest.raises(RunError, match=r"complete in .*run but not drawn \(No space.*python -m harness report .*run "):
        run_on(steady_traffic, configured(), tmp_path / "run", draw=draw)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run"]
    assert run_command_line(["report", str(tmp_path / "run")]) == 0


@pytest.mark.parametrize("broken", [0, 1])
def test_a_run_whose_pictures_cannot_be_drawn_is_finished_and_one_line_warns(broken, steady_traffic, tmp_path, capsys):
    draw = Drawing(*((lambda *_: 1 / 0) if place == broken else (lambda *_: None) for place in range(2)))
    finished = run_on(steady_traffic, configured(), tmp_path / "run", draw=draw)
    assert runfolder.read_manifest(finished.folder, "folder")["status"] == "complete"
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"warning: the run is complete in {finished.folder} but not drawn (ZeroDivisionError: ")


@pytest.mark.slow
@pytest.mark.parametrize("call", [21, 35, 52])
def test_a_disk_that_fills_during_a_run_loses_no_finished_step(call, steady_traffic, tmp_path, monkeypatch, capsys):
    calls = count(1)
    # Room is kept for the manifest and three tables, before the first step and after each.
    monkeypatch.setattr("os.posix_fallocate", lambda *_: no_room() if next(calls) >= call else None)
    steps, left, scored = -(-call // 4) - 1, str(tmp_path / "run.incomplete"), str(tmp_path / "scored")
    with pytest.raises(RunError, match=f"after {steps} steps: No space.*; make room; .*score --truth {left}"):
        run_on(steady_traffic, configured(), tmp_path / "run")
    for name in TABLES[:3]:
        assert pd.read_parquet(tmp_path / "run.incomplete" / name)["step"].nunique() == steps
    assert run_command_line(["score", "--truth", left, "--tracks", left, "--out", scored, "--quiet"]) == 0
    if call != 35:  # what the commands say does not depend on the step
        return
    for command in (["report"], ["export", "--to", "csv"], ["compare", scored]):
        assert run_command_line([command[0], scored, *command[1:]]) in (0, 4)
        assert run_command_line([command[0], left, *command[1:]]) == 2
    assert capsys.readouterr().err.count(f"score --truth {left} --tracks {left}") == 3


def fail_on(name: str, monkeypatch) -> None:
    """Let the disk be full as soon as a file of this name is written."""

    @contextmanager
    def until_full(path: Path) -> Iterator[Path]:
        if path.name == name:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        with replacing(path) as temporary:
            yield temporary

    for module in ("harness.common.files", "harness.storage.tables"):
        monkeypatch.setattr(f"{module}.replacing", until_full)


@pytest.mark.parametrize(
    ("name", "words", "kept"),
    [
        (runfolder.ERRORS, "after 12 steps: .*errors.parquet: No space left on device; make room; the finished", True),
        (runfolder.METRICS, "after 12 steps: .*metrics.json: No space left on device; make room; the finished", True),
        (runfolder.MANIFEST, r"the finished steps are in .*run\.incomplete, manifest\.json found no room", True),
        (runfolder.CONFIG, "before its first step.*No space left on device", False),
        (runfolder.TRACKS, "the finished steps could not be kept.*No space left on device", False),
    ],
)
def test_a_full_disk_keeps_the_steps_that_there_is_room_for(name, words, kept, steady_traffic, tmp_path, monkeypatch):
    fail_on(name, monkeypatch)
    with pytest.raises(RunError, match=words):
        run_on(steady_traffic, configured(), tmp_path / "run")
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.incomplete"] * kept
    assert not kept or pd.read_parquet(tmp_path / "run.incomplete" / "tracks.parquet")["step"].max() == 11
    assert not (tmp_path / "run.incomplete" / runfolder.METRICS).exists()


@pytest.mark.slow
def test_a_run_that_fails_leaves_the_one_that_it_was_to_replace(steady_traffic, tmp_path, capsys):
    first = run_on(steady_traffic, configured(), tmp_path / "run").folder
    before = {path.name: path.read_bytes() for path in first.iterdir()}
    with pytest.raises(RunError):
        run_on(SteadyTraffic(steps=12, fail_at=5), configured(), tmp_path / "run", force=True, quiet=False)
    assert "replaces" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in first.iterdir()} == before
    run_on(SteadyTraffic(steps=12), configured(seed=9), tmp_path / "run", force=True)
    assert json.loads((first / "manifest.json").read_text())["seed"] == 9
    assert {entry.name for entry in tmp_path.iterdir()} == {"run", "run.incomplete"}


@pytest.fixture(scope="module")
def sumo_runs(tmp_path_factory) -> dict[str, Path]:
    """Two short runs on SUMO of the same settings."""
    config = resolve_run_config(options={"density": 10.0, "duration": 2.0, "seed": 1, "particles": 200})
    folder = tmp_path_factory.mktemp("runs")
    return {
        name: run(config, out=folder / name, draw=DRAWING if name == "one" else None).folder for name in ("one", "same")
    }


@pytest.mark.slow
def test_the_same_command_gives_the_same_bytes(sumo_runs):
    for table in (*TABLES, runfolder.DIAGNOSTICS):
        assert (sumo_runs["one"] / table).read_bytes() == (sumo_runs["same"] / table).read_bytes(), table
    metrics = [json.loads((sumo_runs[name] / "metrics.json").read_text()) for name in ("one", "same")]
    for content in metrics:
        del content["timing"]
    assert metrics[0] == metrics[1]


@pytest.mark.slow
def test_a_replay_needs_no_sumo_and_gives_the_same_tracks(sumo_runs, tmp_path, monkeypatch):
    monkeypatch.setattr("harness.truth.sumo.simulation.open_traffic", lambda *_, **__: pytest.fail("SUMO was opened"))
    config = resolve_run_config(options={"replay": str(sumo_runs["one"]), "particles": 200})
    assert config.seed == 1
    again = run(config, out=tmp_path / "again").folder
    for table in TABLES:
        assert (sumo_runs["one"] / table).read_bytes() == (again / table).read_bytes(), table
