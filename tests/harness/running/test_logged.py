"""Logs of any origin are scored as runs are: the formats agree, what they lack is worked out, broken ones are told."""

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import harness
from harness.commands.app import run_command_line
from harness.common import exit_codes
from harness.grid.grid import GridRequest
from harness.grid.stress import run_stress
from harness.running.complete import on_clock
from harness.running.open import open_snapshots
from harness.storage import run_folder as runfolder
from harness.truth.recorded.logs import LogFile
from harness.truth.recorded.messages import read_bag
from mmpf.tracks import Tracks
from tests.harness.full_disk import disk_full_from, moments
from tests.harness.grid.executors import InProcess
from tests.harness.recorded_scene import write_recorded_scene

pytestmark = pytest.mark.usefixtures("no_pictures")

STEPS, STEP_S, SPEED_MPS = 30, 0.1, 10.0
Box = tuple[int, str, float, float, float, float]
BODIES = {1: ("Truck", 15.0, 0.0, 9.0, 2.6), 2: ("Car", 30.0, 0.0, 4.0, 1.6), 3: ("Car", 20.0, 3.5, 4.4, 1.8)}
"""Kind, place before the ego, to its left, length and width: a truck, a car that it hides, and a car beside."""
SCORE_WRITES = 16
"""How many files scoring writes: ledger, settings, road, tables, metrics, manifest, page, ledger again."""
EGO_BOX: Box = (9, "Car", 0.0, 0.0, 4.8, 1.8)


def boxes(step: int, off_m: float = 0.0) -> list[Box]:
    return [
        (name, kind, ahead + off_m, left, length, width) for name, (kind, ahead, left, length, width) in BODIES.items()
    ]


def test_rows_of_one_file_belong_to_the_episodes_that_their_times_tell():
    clock = pd.DataFrame({"step": range(6), "episode": [0, 0, 0, 1, 1, 1], "time_s": 0.1 * np.arange(6)})
    rows = pd.DataFrame({"time_s": clock["time_s"], "id": 7, "episode": 0})
    placed = on_clock(rows, clock.assign(own=clock["time_s"]), "tracks")
    assert placed["step"].tolist() == list(range(6))
    assert placed["episode"].tolist() == clock["episode"].tolist()
    begins_anew = clock.assign(own=[0.0, 0.1, 0.2, 0.0, 0.1, 0.2])  # as in a folder with a file for each episode
    assert on_clock(rows.iloc[:3], begins_anew, "tracks")["step"].tolist() == [0, 1, 2]


def write_csv(folder: Path, role: str, off_m: float) -> tuple[Path, list[str]]:
    identity = {"truth": "vehicle_id"}.get(role, "track_id")
    rows = [
        {"time_s": 5.0 + step * STEP_S, identity: name, "x_m": SPEED_MPS * step * STEP_S + x, "y_m": y,
         "length_m": length, "width_m": width, "yaw_rad": 0.0, "own": 1.0, "at_s": 1.0}
        for step in range(STEPS)
        for name, _, x, y, length, width in [*boxes(step, off_m), *[EGO_BOX] * (role == "truth")]
    ]  # fmt: skip
    path = folder / f"{role}.csv"
    pd.DataFrame(rows).to_csv(path, index=False)
    return path, ["--ego", "9"]


def write_kitti(folder: Path, role: str, off_m: float) -> tuple[Path, list[str]]:
    # In the first camera's frame x is to the right, z ahead; -pi/2 turns a body along z.
    lines = [
        f"{step} {name} {kind} 0 0 0 0 0 0 0 1.5 {width} {length} {-y} 1.6 {x} {-np.pi / 2}"
        for step in range(STEPS)
        for name, kind, x, y, length, width in boxes(step, off_m)
    ]
    (path := folder / f"{role}.txt").write_text("\n".join(lines) + "\n")
    return path, []


def write_mot(folder: Path, role: str, off_m: float) -> tuple[Path, list[str]]:
    with_ego = {9: (0.0, 0.0)} if role == "truth" else {}
    lines = [
        f"{step + 1},{name},-1,-1,-1,-1,1,{SPEED_MPS * step * STEP_S + x},{y},-1"
        for step in range(STEPS)
        for name, (x, y) in ({each[0]: each[2:4] for each in boxes(step, off_m)} | with_ego).items()
    ]
    (path := folder / f"{role}.txt").write_text("\n".join(lines) + "\n")
    return path, ["--ego", "9"]


def write_nuscenes(folder: Path, role: str, off_m: float) -> tuple[Path, list[str]]:
    results = {
        f"s{step}": [
            {"sample_token": f"s{step}", "translation": [SPEED_MPS * step * STEP_S + x, y, 0.0],
             "rotation": [1, 0, 0, 0], "size": [width, length, 1.5], "velocity": [SPEED_MPS, 0.0],
             "tracking_id": str(name), "tracking_name": kind.lower()}
            for name, kind, x, y, length, width in boxes(step, off_m)
        ]
        for step in range(STEPS)
    }  # fmt: skip
    (path := folder / f"{role}.json").write_text(json.dumps({"meta": {}, "results": results}))
    at = np.arange(STEPS) * STEP_S
    poses = pd.DataFrame({"sample_token": list(results), "time_s": at, "lon_m": SPEED_MPS * at, "lat_m": 0.0})
    poses.assign(heading_rad=0.0).to_csv(folder / "poses.csv", index=False)
    return path, ["--ego", str(folder / "poses.csv")]


WRITERS: dict[str, Callable[[Path, str, float], tuple[Path, list[str]]]] = {
    "csv": write_csv, "kitti": write_kitti, "mot": write_mot, "nuscenes": write_nuscenes,
}  # fmt: skip


def score(folder: Path, truth: Path, tracks: Path, *more: str) -> int:
    words = ["--truth", str(truth), "--tracks", str(tracks), "--out", str(folder / "scored"), "--quiet", "--force"]
    return run_command_line(["score", *words, *more])


@pytest.mark.parametrize("write", moments(SCORE_WRITES, often=12))
def test_a_disk_that_fills_while_a_log_is_scored_leaves_nothing(tmp_path, write, capsys):
    (truth, more), (tracks, _) = (write_csv(tmp_path, role, 0.0) for role in ("truth", "tracks"))
    with disk_full_from(write):
        assert score(tmp_path, truth, tracks, *more) == exit_codes.RUN_FAILED
    assert capsys.readouterr().err.count("\n") == 1
    assert {*tmp_path.iterdir()} == {truth, tracks}


@pytest.mark.slow
def test_scoring_writes_as_often_as_the_moments_above_suppose(tmp_path):
    (truth, more), (tracks, _) = (write_csv(tmp_path, role, 0.0) for role in ("truth", "tracks"))
    with disk_full_from(SCORE_WRITES + 1) as written:
        assert score(tmp_path, truth, tracks, *more) == 0
    assert len(written) == SCORE_WRITES
    assert (tmp_path / "scored" / "report.html").is_file()
    assert json.loads((tmp_path / "scored" / runfolder.MANIFEST).read_text())["is_log"]


def metrics_of(folder: Path) -> dict[str, object]:
    read: dict[str, object] = json.loads((folder / runfolder.METRICS).read_text())
    # Of the clock, of what the run is called, and of what the tracker thinks of vehicles that it never saw.
    return {name: table for name, table in read.items() if name not in ("timing", "run", "never_seen")}


@pytest.mark.parametrize("format_", WRITERS)
def test_each_format_gives_the_errors_that_were_put_in_and_hides_what_the_truck_covers(tmp_path, format_):
    (tmp_path / "log").mkdir()
    truth, more = WRITERS[format_](tmp_path, "truth", 0.0)
    tracks, _ = WRITERS[format_](tmp_path / "log", "tracks", 0.3)
    assert score(tmp_path, truth, tracks, *more) == 0
    run = harness.open_run(tmp_path / "scored")
    values = run.metrics["value"]
    assert values["mae.all.lon_m"] == pytest.approx(0.3, abs=1e-3)
    assert values["mae.all.lat_m"] == pytest.approx(0.0, abs=1e-3)
    assert values["mot.id_switches"] == 0
    assert values.filter(regex="calibration.nees|crps|ellipse90").isna().all()
    seen = run.truth.groupby("vehicle_id")["state"].agg(set)
    if format_ != "mot":  # it tells no sizes: a usual car hides a usual car all the same
        assert run.truth.groupby("vehicle_id")["length_m"].first()["1"] == pytest.approx(9.0)
    assert (seen["2"], seen["3"]) == ({"hidden"}, {"visible"})
    if format_ == "csv":
        assert run_command_line(["report", str(run.folder)]) == 0
        assert run_command_line(["export", str(run.folder), "--to", "mot"]) == 0


@pytest.mark.slow
@pytest.mark.parametrize("scored", [True, False])
def test_nuscenes_results_with_scores_have_amota_and_amotp_by_its_rules(scored, tmp_path, capfd):
    (tmp_path / "log").mkdir()
    truth, more = write_nuscenes(tmp_path, "truth", 0.0)
    tracks, _ = write_nuscenes(tmp_path / "log", "tracks", 0.3)
    table = json.loads(tracks.read_text())
    for box in (box for found in table["results"].values() for box in found if scored):
        box["tracking_score"] = 0.5
    tracks.write_text(json.dumps(table))
    words = ["--truth", str(truth), "--tracks", str(tracks), "--out", str(tmp_path / "scored"), *more]
    assert run_command_line(["score", *words]) == 0
    told = metrics_of(tmp_path / "scored")
    assert ("by nuScenes' rules AMOTA is 1.000 and AMOTP 0.300 m" in capfd.readouterr().err) == scored
    assert ("nuscenes" in told) == scored
    if scored:
        # Of each class the recall of the first box is above 10 %, and every other box is 0.3 m off as well.
        assert told["nuscenes"]["by_class"] == {
            name: {"amota": pytest.approx(1.0), "amotp": pytest.approx(0.3)} for name in ("car", "truck")
        }


def test_mot_truth_is_boxes_with_class_and_visibility_and_is_not_scored_with_confidence_0(tmp_path):
    (path := tmp_path / "gt.txt").write_text("1,1,300,-100,400,200,0,1,.5\n1,2,700,-100,400,200,1,1,.7\n")
    assert LogFile(path, "truth").read()[["lon_m", "pedestrian"]].to_numpy().tolist() == [[5.0, True], [9.0, False]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> harness.Run:
    """Return a run that no test may change."""
    folder = tmp_path_factory.mktemp("logged")
    return harness.run(replay=write_recorded_scene(folder / "scene"), tracker="detections", out=folder / "run")


def test_times_may_be_off_by_a_tenth_of_a_step_and_what_is_outside_of_the_truth_is_left_out(tmp_path, run, capfd):
    tracks, path = pd.read_parquet(run.folder / runfolder.TRACKS), tmp_path / "log.parquet"
    for late_s, code in ((0.0099, 0), (0.0101, 2), (0.05, 2)):
        tracks.assign(time_s=tracks["time_s"] + late_s).to_parquet(path)
        assert score(tmp_path, run.folder, path) == code
        assert ("between the truth's times" in capfd.readouterr().err) == (code == 2)
    assert metrics_of(tmp_path / "scored")["mot"] == metrics_of(run.folder)["mot"]
    soon = tracks[tracks["step"] == tracks["step"].min()].assign(time_s=run.truth["time_s"].min() - 0.04)
    pd.concat([soon, tracks]).to_parquet(path)
    assert score(tmp_path, run.folder, path) == 0
    assert f"left out: {len(soon)} at no time of the truth" in capfd.readouterr().err
    later = tracks.assign(time_s=tracks["time_s"] + 1.0)
    later.to_parquet(path)
    assert score(tmp_path, run.folder, path) == 0
    outside = int((later["time_s"] > run.truth["time_s"].max() + 0.05).sum())
    assert f"left out: {outside} at no time of the truth" in capfd.readouterr().err
    tracks[:0].to_parquet(path)
    assert score(tmp_path, run.folder, path) == 0
    assert "0 rows of tracks at 0 of" in capfd.readouterr().err


def test_a_log_of_a_run_has_the_run_s_own_scores(tmp_path, run):
    assert score(tmp_path, run.folder, run.folder / runfolder.TRACKS) == 0
    assert metrics_of(tmp_path / "scored") == metrics_of(run.folder)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_tables_score_like_the_folder_that_they_are_of(tmp_path, run, suffix):
    lie = tmp_path / "tables"
    lie.mkdir()
    (lie / runfolder.ROAD).write_bytes((run.folder / runfolder.ROAD).read_bytes())
    for name in ("truth", "tracks", "detections"):
        rows = getattr(run, name).sample(frac=1.0, random_state=1)
        rows.to_csv(lie / f"{name}.csv", index=False) if suffix == "csv" else rows.to_parquet(lie / f"{name}.parquet")
    shown = ["--detections", str(lie / f"detections.{suffix}"), "--seed", "7"]
    assert score(tmp_path, lie / f"truth.{suffix}", lie / f"tracks.{suffix}", *shown) == 0
    scored = metrics_of(tmp_path / "scored")
    for name in ("mae", "mot", "hidden", "coverage", "calibration"):
        pd.testing.assert_series_equal(
            pd.json_normalize(scored[name]).iloc[0], pd.json_normalize(metrics_of(run.folder)[name]).iloc[0]
        )


@pytest.mark.slow
@pytest.mark.forks
def test_a_recording_for_foxglove_is_read_back_unless_a_bit_of_a_chunk_or_the_summary_flips(tmp_path, run, capfd):
    (bag,) = run_export(run.folder, tmp_path / "mcap")
    assert score(tmp_path, run.folder, Path(f"{bag}:/tracks")) == 0
    scored, own, data = metrics_of(tmp_path / "scored"), metrics_of(run.folder), bag.read_bytes()
    assert scored["mot"] == own["mot"]
    for place in (2000, len(data) - 2000):
        bag.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])
        assert score(tmp_path, run.folder, Path(f"{bag}:/tracks")) == exit_codes.WRONG_INPUT
        assert capfd.readouterr().err.count("error: --tracks: ") == 1


@pytest.mark.slow
def test_a_bag_of_autoware_s_messages_is_read_back_with_the_same_scores(tmp_path, run):
    (bag,) = run_export(run.folder, tmp_path / "bag", "autoware")
    topic = "/perception/object_recognition/tracking/objects"
    assert score(tmp_path, run.folder, Path(f"{bag}:{topic}")) == 0
    scored, own = metrics_of(tmp_path / "scored"), metrics_of(run.folder)
    assert scored["mot"] == own["mot"]
    assert scored["calibration"] == own["calibration"]
    tracks = run.tracks[run.tracks["state"] != "tentative"].reset_index(drop=True)
    read = read_bag(bag, "tracks", topic)
    for name in ("time_s", "lon_m", "lat_m", "speed_mps", "lat_speed_mps", "accel_mps2", "std_lon_m", "std_lat_m"):
        np.testing.assert_allclose(read[name], tracks[name], atol=1e-9, err_msg=name)
    assert (pd.factorize(read["id"])[0] == pd.factorize(tracks["track_id"])[0]).all()
    found = read_bag(bag, "detections", topic.replace("tracking", "detection"))
    np.testing.assert_allclose(found[["lon_m", "lat_m"]], run.detections[["lon_m", "lat_m"]], atol=1e-9)
    ego = run.truth[run.truth["is_ego"]]
    np.testing.assert_allclose(read_bag(bag, "ego", None)[["lon_m", "lat_m"]], ego[["lon_m", "lat_m"]], atol=1e-9)


@pytest.mark.slow
def test_a_bag_of_autoware_s_messages_is_replayed_with_its_detections_and_its_truth(tmp_path, run, capfd):
    (bag,) = run_export(run.folder, tmp_path / "bag", "autoware")
    assert (
        run_command_line(["run", "--replay", str(bag), "--tracker", "oc-sort", "--out", str(tmp_path / "again")]) == 0
    )
    assert "truth: /perception/object_recognition/ground_truth/objects" in capfd.readouterr().err
    again = harness.open_run(tmp_path / "again")
    keys = ["time_s", "lon_m", "lat_m"]
    for name, columns in (
        ("detections", [*keys, "std_lon_m", "std_lat_m"]),
        ("truth", [*keys, "speed_mps", "accel_mps2", "heading_rad", "length_m", "width_m"]),
    ):
        of, read = getattr(run, name), getattr(again, name)
        if name == "truth":  # of the ego there is a transform alone; a bag's speeds are along an object's own heading
            of, read = (table[~table["is_ego"]] for table in (of, read))
            of, read = (t.assign(speed_mps=np.hypot(t["speed_mps"], t["lat_speed_mps"])) for t in (of, read))
        of, read = (table.sort_values(keys)[columns].to_numpy() for table in (of, read))
        np.testing.assert_allclose(read, of, atol=1e-6)
    ego = [table[table["is_ego"]][keys].to_numpy() for table in (run.truth, again.truth)]
    np.testing.assert_allclose(ego[1], ego[0], atol=1e-6)
    assert len(again.tracks) > 0
    short = harness.run(replay=bag, tracker="detections", duration=1.0, out=tmp_path / "short")
    assert short.truth["step"].nunique() == 10
    for path, duration_s in ((bag, 1.0), (run.folder, None)):
        request = GridRequest(net=None, replay=(str(path),), trackers="detections", seeds="1", duration_s=duration_s)
        assert not run_stress(request, tmp_path / f"{path.stem}-grid", InProcess(open_snapshots)).failures


def test_a_bag_without_the_ego_s_transform_is_one_line(tmp_path, refused):
    from mcap_ros2.writer import Writer  # noqa: PLC0415

    from harness.export.autoware_bag import TRACKED, definition  # noqa: PLC0415

    with (tmp_path / "bag.mcap").open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef(TRACKED.replace("/", "/msg/"), definition(TRACKED))
        header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "map"}
        writer.write_message("/tracks", schema, {"header": header, "objects": []}, 0, 0)
        writer.finish()
    assert "bag.mcap" in refused("run", "--replay", "bag.mcap", "--tracker", "oc-sort")


def test_a_bag_whose_truth_has_vehicles_twice_is_one_line(tmp_path, run, refused, monkeypatch):
    (bag,) = run_export(run.folder, tmp_path / "bag", "autoware")
    read = LogFile.read
    monkeypatch.setattr(LogFile, "read", lambda log: pd.concat([read(log), read(log)], ignore_index=True))
    assert "is there twice at 0 s" in refused("run", "--replay", bag, "--tracker", "oc-sort")


@pytest.mark.slow
def test_a_track_in_the_plane_has_no_heading_in_a_bag_of_autoware_s_messages(tmp_path):
    run = harness.run(replay="pandaset", tracker="oracle-kalman", duration=1.0, out=tmp_path / "run")
    (bag,) = run_export(run.folder, tmp_path / "bag", "autoware")
    topic = "/perception/object_recognition/tracking/objects"
    with bag.open("rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=[topic])
        known = {each.kinematics.orientation_availability for *_, message in messages for each in message.objects}
    assert known == {0}


@pytest.mark.parametrize("column", ["lon_m", "speed_mps", "existence"])
def test_a_text_in_a_number_column_of_a_log_is_one_line(column, tmp_path, run, capsys):
    log = run.tracks.astype({column: object})
    log.loc[3, column] = "0.5\ufeff"
    log.to_csv(tmp_path / "log.csv", index=False)
    assert score(tmp_path, run.folder, tmp_path / "log.csv") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error:")
    assert "log.csv" in line
    assert "0.5" in line


def run_export(folder: Path, out: Path, to: str = "mcap") -> list[Path]:
    assert run_command_line(["export", str(folder), "--to", to, "--out", str(out)]) == 0
    return sorted(out.glob("*.mcap"))


@pytest.mark.slow
def test_a_program_that_reads_the_exported_scans_has_the_scores_of_the_run_with_it_and_never_sees_the_truth(tmp_path):
    scene = write_recorded_scene(tmp_path / "scene")
    program = [sys.executable, str(Path(__file__).parents[3] / "docs" / "examples" / "exec_tracker.py")]
    run = harness.run(replay=scene, tracker=f"exec:{shlex.join(program)}", out=tmp_path / "run")
    run_export(run.folder, tmp_path / "scans", "scans")
    text = (tmp_path / "scans" / "episode-0.txt").read_text()
    times = {words[1]: float(words[2]) for words in map(str.split, text.splitlines()) if words[0] == "scan"}
    answers = subprocess.run(program, input=text, capture_output=True, text=True, check=True).stdout.splitlines()[1:]
    rows, time_s = [], 0.0
    for words in map(str.split, answers):
        if words[0] == "tracks":
            time_s = times[words[1]]
        else:
            rows.append([time_s, *words])
    pd.DataFrame(rows, columns=["time_s", *Tracks.__dataclass_fields__]).to_csv(tmp_path / "log.csv", index=False)
    assert score(tmp_path, run.folder, tmp_path / "log.csv") == 0
    assert metrics_of(tmp_path / "scored") == metrics_of(run.folder)
    for file in (tmp_path / "scans").iterdir():
        words = set(re.split(r"\W", file.read_text()))
        assert not {"truth_id", "vehicle_id", "visible_fraction", "near", "far"} & words


BROKEN = {
    "empty.csv": b"", "garbage.csv": b"\x00\xff\x13" * 50, "no_place.csv": b"time_s,track_id\n0.0,1\n",
    "no_number.csv": b"time_s,track_id,lon_m,lat_m\n0.0,1,here,0\n",
    "infinite.csv": b"time_s,track_id,lon_m,lat_m\n0.0,1,inf,0\n",
    "ms.csv": b"time_s,track_id,lon_m,lat_m\n" + b"".join(b"%d,1,1,0\n" % (100 * step) for step in range(200)),
    "half.txt": b"1,1.5,-1,-1,-1,-1,1,1.0,0,-1\n", "far.txt": b"0 1e20 Car 0 0 0 0 0 0 0 1.5 1.8 4.4 0 1.6 20 0\n",
    "no_share.csv": b"time_s,track_id,lon_m,lat_m,existence\n0.1,7,1.0,0,\n",
    "half.csv": b"time_s,track_id,lon_m,lat_m\n0.0,4.5,1.0,0\n",
    "drive.csv": b"time_s,episode,track_id,lon_m,lat_m\n0.0,0.5,1,1.0,0\n",
    "below_zero.csv": b"time_s,track_id,lon_m,lat_m\n0.0,-1,1.0,0\n", "cut.json": b'{"results": {"a": [',
    "none.json": b'{"meta": {}}', "list.json": b"[1, 2]", "short.txt": b"0 1 Car 0 0\n",
    "words.txt": b"1,2,a,b,c,d,1,-1,-1,-1\n", "cut.parquet": b"PAR1\x00\x00", "cut.mcap": b"\x89MCAP0\r\n",
    "odd.xyz": b"\x01\x02\x03",
}  # fmt: skip


@pytest.mark.forks
@pytest.mark.parametrize("name", [pytest.param(n, marks=() if "cut" in n else pytest.mark.slow) for n in BROKEN])
def test_a_broken_log_is_one_line_that_names_the_file(tmp_path, name, capfd):
    truth, more = write_mot(tmp_path, "truth", 0.0)
    (tmp_path / name).write_bytes(BROKEN[name])
    assert score(tmp_path, truth, tmp_path / name, *more) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("error: --tracks")
    assert not (tmp_path / "scored").exists()


@pytest.mark.slow
def test_what_is_missing_or_does_not_belong_together_is_one_line(tmp_path, run, capfd):
    log, truth = run.folder / runfolder.TRACKS, write_mot(tmp_path, "truth", 0.0)[0]
    (twice := tmp_path / "twice.txt").write_text(2 * truth.read_text())
    (leap := tmp_path / "leap.txt").write_text(truth.read_text().replace(",1,30.0,", ",1,300.0,"))
    (poses := tmp_path / "poses.csv").write_text("time_s,lon_m,lat_m,heading_rad\n0,0,0..0,0\n")
    (late := tmp_path / "late.txt").write_text(truth.read_text().replace("\n20,", "\n200,").replace("\n3", "\n30"))
    (words := tmp_path / "words.csv").write_text("time_s,episode,lon_m,lat_m,heading_rad\n0,x,0,0,0\n")
    (other := tmp_path / "other").mkdir()
    (nameless := tmp_path / "nameless.csv").write_text("time_s,vehicle_id,lon_m,lat_m\n0,,0,0\n")
    timed, _ = write_csv(other, "truth", 0.0)
    samples, more = write_nuscenes(other, "truth", 0.0)
    (untimed := tmp_path / "untimed.csv").write_text("sample_token,lon_m,lat_m,heading_rad\ns0,0,0,0\n")
    (tokens := tmp_path / "tokens.csv").write_text("sample_token,vehicle_id,lon_m,lat_m\ns0,9,0,0\n")
    (many := tmp_path / "many.txt").write_text("".join(f"1,{k},-1,-1,-1,-1,1,{k},0,-1\n" for k in range(3000)))
    calls = [
        (["--ego", "9"], twice, log, "is there twice at"), (["--ego", "9"], leap, log, "leaps at"),
        (["--ego", str(poses)], truth, log, "lat_m holds "), (["--ego", str(words)], truth, log, "no whole number"),
        (["--ego", "9"], nameless, log, "1 rows have no identity"),
        (["--ego", "9"], late, log, "s pass between two of its times"),
        (["--ego", "9"], many, log, "3000 vehicles at one time"),
        (["--ego", "9"], truth, tmp_path / "none.csv", "--tracks"), (["--ego", "77"], truth, log, "--ego"),
        ([], truth, log, "--ego"), (["--ego", "ego"], run.folder, log, "--ego"),
        (["--format", "odd"], run.folder, log, "--format"), (["--ego", "9", "--set", "seed=3"], truth, log, "--set"),
        (["--ego", "9", "--set", "sensor.range_m=-1"], truth, log, "sensor.range_m"),
        (["--ego", "9", "--step", "0"], truth, log, "--step"), (["--step", "0.2"], run.folder, log, "of their own"),
        (["--ego", "9", "--step", "0.1"], timed, log, "of their own"),
        ([*more, "--step", "0.1"], samples, samples, "of their own"),
        (["--ego", str(untimed)], samples, samples, "lacks the column time_s"), (["--ego", "9"], tokens, log, "poses"),
    ]  # fmt: skip
    capfd.readouterr()
    for more, of, tracks, named in calls:
        assert score(tmp_path, of, tracks, *more) == 2, more
        (line,) = capfd.readouterr().err.splitlines()
        assert named in line
    assert score(tmp_path, truth, truth, "--ego", "9", "--step", "0.2") == 0
    assert runfolder.read_table(tmp_path / "scored", runfolder.TRUTH, "truth")["time_s"].nunique() == STEPS


def test_a_row_without_deviation_leaves_calibration_open_and_one_that_is_unclear_is_refused(tmp_path, run, capsys):
    tracks, path = pd.read_parquet(run.folder / runfolder.TRACKS), tmp_path / "some.parquet"
    tracks.assign(std_lat_m=tracks["std_lat_m"].where(tracks.index > 0)).to_parquet(path)
    assert score(tmp_path, run.folder, path) == 0
    assert pd.json_normalize(metrics_of(tmp_path / "scored")["calibration"]).isna().all(axis=None)
    tracks.assign(track_id=tracks["track_id"].astype("Int64").where(tracks.index > 0)).to_parquet(path)
    assert score(tmp_path, run.folder, path) == 2
    assert "1 rows have no identity" in capsys.readouterr().err
    tracks.assign(state="Tentative").to_parquet(path)
    for words, told in (((), "--tracks: state holds 'Tentative'"), (("--set", "tracker.name=pmbm"), "--set: tracker ")):
        assert score(tmp_path, run.folder, path, *words) == 2
        assert told in capsys.readouterr().err
