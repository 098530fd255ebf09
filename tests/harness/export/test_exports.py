"""Each format read back by the program that it is meant for."""

import errno
import gzip
import itertools
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.commands.app import run_command_line
from harness.common.errors import InputError, RunError
from harness.common.exit_codes import WRONG_INPUT
from harness.export.curves import curves_of
from harness.export.formats import export_run
from harness.export.sizes import track_sizes
from harness.report import video
from harness.report.video import write_video
from harness.running.finished import read_recorded_run
from harness.storage.lock import LOCK
from harness.truth.network.network import load_network
from harness.truth.recorded.fcd import read_fcd
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.road import Lane
from tests.harness.recorded_scene import (
    GIVEN_UP,
    LAST_SEEN,
    SEEN_AGAIN,
    STEPS,
    metrics_of,
    rewrite,
    write_recorded_scene,
)
from tests.mmpf.map.scenes import graph_of

# A road that turns from east to north-east, so that the road frame and the plane differ.
BENT = CorridorRoad(
    lanes=tuple(Lane(number, 3.66 * (5 - number), 3.66 * (6 - number)) for number in range(1, 6)),
    reference_xy=((1000.0, 50.0), (1150.0, 50.0), (1350.0, 250.0)),
)


@pytest.fixture
def folder(tmp_path):
    return write_recorded_scene(tmp_path / "run")


@pytest.fixture
def bent(tmp_path):
    return write_recorded_scene(tmp_path / "bent", road=BENT)


def test_csv_holds_every_table_as_it_was(folder):
    pd.DataFrame({"step": [0], "time_s": [0.0], "own": ["x"]}).to_parquet(folder / "own.parquet")
    files = export_run(folder, "csv")
    assert {file.stem for file in files} == {path.stem for path in folder.glob("*.parquet")}
    assert len(files) > 5
    for file in files:
        table = pd.read_parquet(folder / f"{file.stem}.parquet")
        read = pd.read_csv(file, keep_default_na=False, na_values=[""])
        assert list(read) == list(table)
        assert len(read) == len(table)
        numbers = table.select_dtypes("number").columns
        np.testing.assert_array_equal(read[numbers].to_numpy(float), table[numbers].to_numpy(float))


def schema(name):
    """Return one of SUMO's own schemas."""
    xmlschema = pytest.importorskip("xmlschema", reason="validates by SUMO's schemas")
    sumo_data = pytest.importorskip("sumo_data", reason="has SUMO's schemas")
    return xmlschema.XMLSchema(str(Path(next(iter(sumo_data.__path__))) / "data" / "xsd" / name))


def test_sumo_reads_the_floating_car_data(bent):
    sumolib = pytest.importorskip("sumolib")
    file, types = export_run(bent, "fcd")
    steps = list(sumolib.xml.parse(str(file), "timestep"))
    sizes = {kind.id: (float(kind.length), float(kind.width)) for kind in sumolib.xml.parse(str(types), "vType")}
    assert [float(step.time) for step in steps] == pytest.approx(0.1 * np.arange(STEPS), abs=1e-9)
    run = read_recorded_run(bent)
    truth = run.truth[run.truth["step"] == 50].set_index("vehicle_id")
    for vehicle in steps[50].vehicle:
        row = truth.loc[vehicle.id]
        heading = np.radians(90.0 - float(vehicle.angle))
        length, width = sizes[vehicle.type]
        x, y = float(vehicle.x) - 0.5 * length * np.cos(heading), float(vehicle.y) - 0.5 * length * np.sin(heading)
        lon, lat = run.road.to_road(np.array([x]), np.array([y]))
        assert lon[0] == pytest.approx(row["lon_m"], abs=1e-3)
        assert lat[0] == pytest.approx(row["lat_m"], abs=1e-3)
        along = float(run.road.heading_at(np.array(row["lon_m"])))
        assert heading - along == pytest.approx(row["heading_rad"], abs=1e-5)
        assert float(vehicle.speed) * np.cos(row["heading_rad"]) == pytest.approx(row["speed_mps"], abs=1e-3)
        assert width == row["width_m"]


def test_in_the_plane_the_speed_of_the_floating_car_data_is_that_along_the_body(tmp_path):
    graph = graph_of({str(lane): [(0.0, 3.5 * lane), (500.0, 3.5 * lane)] for lane in range(5)})
    folder = write_recorded_scene(tmp_path / "plane", road=LaneGraphRoad(graph=graph))
    truth = pd.read_parquet(folder / "truth.parquet")
    rewrite(folder, "truth.parquet", truth.assign(heading_rad=np.linspace(-3.0, 3.0, len(truth)), lane=1))
    file, _ = export_run(folder, "fcd")
    written = re.findall(r' speed="([-.0-9]+)"', file.read_text())
    assert [float(speed) for speed in written] == pytest.approx(truth["speed_mps"].tolist(), abs=1e-4)


@pytest.mark.slow
def test_the_floating_car_data_are_valid_by_sumos_own_schemas(tmp_path):
    folder = write_recorded_scene(tmp_path / "run", {"far": 'a "quoted" <name> & more', "near": "bell\x07"}, road=BENT)
    truth = pd.read_parquet(folder / "truth.parquet")
    truth["lon_m"] -= 400.0  # before the road's zero, from where SUMO counts places
    truth.to_parquet(folder / "truth.parquet")
    file, types = export_run(folder, "fcd")
    schema("fcd_file.xsd").validate(str(file))
    schema("additional_file.xsd").validate(str(types))


def test_floating_car_data_are_packed_where_the_files_name_says_so(folder, tmp_path):
    plain, _ = export_run(folder, "fcd", tmp_path / "plain.xml")
    packed, types = export_run(folder, "fcd", tmp_path / "packed.xml.gz")
    assert gzip.decompress(packed.read_bytes()) == plain.read_bytes()
    assert types.name == "packed.vtypes.xml"
    before = packed.read_bytes()
    with pytest.raises(InputError, match="`force`"):
        export_run(folder, "fcd", packed)
    assert export_run(folder, "fcd", packed, force=True) == [packed, types]
    assert packed.read_bytes() == before
    (tmp_path / "thesis.xml").write_text("<thesis/>")
    with pytest.raises(InputError, match="not an earlier export"):
        export_run(folder, "fcd", tmp_path / "thesis.xml", force=True)
    assert {path.name for path in tmp_path.iterdir()} == {
        *("run", "plain.xml", "plain.vtypes.xml", "packed.xml.gz", "packed.vtypes.xml", "thesis.xml")
    }


@pytest.mark.parametrize("name", ["csv", "fcd"])
def test_a_folder_of_files_is_packed_on_request(name, folder, tmp_path):
    plain, packed = export_run(folder, name), export_run(folder, name, tmp_path / "out", packed=True)
    assert [f"{file.name}.gz" for file in plain] == [file.name for file in packed]
    assert [file.read_bytes() for file in plain] == [gzip.decompress(file.read_bytes()) for file in packed]
    assert export_run(folder, name, tmp_path / "out", force=True, packed=True) == packed
    with pytest.raises(InputError, match=r"^`gzip`: only csv and fcd"):
        export_run(folder, "mot", packed=True)


@pytest.mark.parametrize("packed", [False, True])
def test_the_harness_reads_its_own_floating_car_data(packed, tmp_path):
    folder = write_recorded_scene(tmp_path / "run", road=load_network("us101").road)
    file, _ = export_run(folder, "fcd", packed=packed)
    run = read_recorded_run(folder)
    rows = read_fcd(file, "us101").rows
    order = np.lexsort((np.round(rows.lon_m, 2), rows.time_s))
    truth = run.truth.sort_values(["time_s", "lon_m"])
    for column in ("time_s", "lon_m", "lat_m", "speed_mps", "length_m", "width_m", "heading_rad"):
        expected = truth[column].to_numpy(float)
        np.testing.assert_allclose(getattr(rows, column)[order], expected, atol=2e-3, err_msg=column)


@pytest.mark.parametrize(("sequence", "key"), [("in-sight", "mot"), ("seen-in-10-s", "mot_all")])
def test_trackeval_scores_the_exported_run_as_the_harness_does(folder, sequence, key):
    trackeval = pytest.importorskip("trackeval", reason="TrackEval is the reader of this format")
    from harness.export.trackeval_script import ByPosition  # noqa: PLC0415

    export_run(folder, "mot")
    dataset = ByPosition(
        {
            "GT_FOLDER": str(folder / "export" / "mot" / "gt"), "TRACKERS_FOLDER": str(folder / "export/mot/trackers"),
            "SKIP_SPLIT_FOL": True, "SEQMAP_FILE": str(folder / "export/mot/seqmap.txt"), "DO_PREPROC": False,
            "PRINT_CONFIG": False,
        }
    )  # fmt: skip
    assert dataset.seq_list == ["in-sight", "seen-in-10-s"]
    raw = dataset.get_raw_seq_data("mmpf", sequence)
    data = dataset.get_preprocessed_seq_data(raw, "pedestrian")
    scores = metrics_of(folder)[key]
    quiet = {"PRINT_CONFIG": False}
    hota = trackeval.metrics.HOTA().eval_sequence(data)
    clear = trackeval.metrics.CLEAR(quiet).eval_sequence(data)
    identity = trackeval.metrics.Identity(quiet).eval_sequence(data)
    assert 0.0 < scores["hota"] < 100.0
    assert 100.0 * np.mean(hota["HOTA"]) == pytest.approx(scores["hota"], abs=1e-6)
    assert 100.0 * np.mean(hota["AssA"]) == pytest.approx(scores["assa"], abs=1e-6)
    assert 100.0 * clear["MOTA"] == pytest.approx(scores["mota"], abs=1e-6)
    assert 100.0 * identity["IDF1"] == pytest.approx(scores["idf1"], abs=1e-6)
    assert clear["IDSW"] == scores["id_switches"]
    assert clear["CLR_FN"] == scores["missed"]
    assert clear["CLR_FP"] == scores["false_tracks"]


@pytest.mark.slow
def test_the_script_beside_the_files_prints_the_runs_own_scores(folder):
    pytest.importorskip("trackeval", reason="TrackEval is the reader of this format")
    files = export_run(folder, "mot")
    script = next(file for file in files if file.name == "score.py")
    said = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, timeout=120).stdout
    for sequence, key in (("in-sight", "mot"), ("seen-in-10-s", "mot_all")):
        line = next(line.split() for line in said.splitlines() if line.startswith(sequence))
        wanted = [metrics_of(folder)[key][name] for name in ("hota", "assa", "mota", "idf1", "id_switches")]
        assert [float(word) for word in line[1:]] == pytest.approx(wanted, abs=0.006)


def with_measured_sizes(folder, rng):
    """Let the sensor of a run measure sizes, with noise: 4.5 by 1.8 m of all, which a usual car has not."""
    path = folder / "detections.parquet"
    table = pd.read_parquet(path)
    for name, size in (("length_m", 4.5), ("width_m", 1.8)):
        table[name], table[f"std_{name}"] = size + rng.normal(0.0, 0.2, len(table)), 0.2
    table.loc[table.index[::7], "length_m"] = np.nan
    table.to_parquet(path)


def test_tracks_are_as_large_as_what_was_measured_of_them(folder):
    assert track_sizes(read_recorded_run(folder), np.array([0, 0]), np.array([1, 99])).tolist() == [[4.7, 1.9]] * 2
    with_measured_sizes(folder, np.random.default_rng(2))
    sizes = track_sizes(read_recorded_run(folder), np.zeros(4, dtype=int), np.array([1, 2, 3, 99]))
    np.testing.assert_allclose(sizes[:3], [[4.5, 1.8]] * 3, atol=0.15)
    assert sizes[3].tolist() == [4.7, 1.9]  # no such track
    files = {file.name: file for file in export_run(folder, "mot")}
    boxes = np.loadtxt(files["in-sight.txt"], delimiter=",")
    of_first = boxes[boxes[:, 1] == boxes[0, 1]]
    np.testing.assert_allclose(of_first[:, 4:6], np.broadcast_to(100.0 * sizes[0], (len(of_first), 2)), atol=0.01)
    truth = np.loadtxt(files["gt.txt"], delimiter=",")
    assert set(map(tuple, truth[:, 4:6])) == {(450.0, 180.0)}


def osi_messages(folder):
    reader = pytest.importorskip("osi3trace.osi_trace", reason="the extra osi is not installed")
    traces = zip(export_run(folder, "osi"), ("GroundTruth", "SensorData", "SensorData"), strict=False)
    for trace in itertools.starmap(reader.OSITrace, traces):
        yield list(trace)
        trace.close()


def test_an_osi_reader_finds_vehicles_detections_and_tracks(bent):
    run = read_recorded_run(bent)
    truths, detections, tracks = osi_messages(bent)
    assert len(truths) == len(detections) == len(tracks) == STEPS
    step = GIVEN_UP - 1
    assert [len(found[step].moving_object) for found in (truths, detections, tracks)] == [4, 1, 2]
    assert truths[step].timestamp.seconds + 1e-9 * truths[step].timestamp.nanos == pytest.approx(0.1 * step)
    host = next(v for v in truths[step].moving_object if v.id.value == truths[step].host_vehicle_id.value)
    held = next(found for found in tracks[step].moving_object if found.header.tracking_id.value == 2)
    # From the ego's frame back to the plane and to the road, the track is where the table has it.
    yaw, offset = host.base.orientation.yaw, held.base.position
    x = host.base.position.x + offset.x * np.cos(yaw) - offset.y * np.sin(yaw)
    y = host.base.position.y + offset.x * np.sin(yaw) + offset.y * np.cos(yaw)
    lon, lat = run.road.to_road(np.array([x]), np.array([y]))
    row = run.tracks[(run.tracks["step"] == step) & (run.tracks["track_id"] == 2)].iloc[0]
    assert (lon[0], lat[0]) == pytest.approx((row["lon_m"], row["lat_m"]), abs=1e-6)
    turn = run.road.heading_at(lon)[0] - yaw
    speed = (row["speed_mps"], row["lat_speed_mps"])
    assert held.base.velocity.x == pytest.approx(speed[0] * np.cos(turn) - speed[1] * np.sin(turn), abs=1e-6)
    assert held.base.velocity.y == pytest.approx(speed[0] * np.sin(turn) + speed[1] * np.cos(turn), abs=1e-6)
    spread = np.hypot(row["std_lon_m"] * np.cos(turn), row["std_lat_m"] * np.sin(turn))
    assert held.base_rmse.position.x == pytest.approx(spread, abs=1e-6)
    assert held.header.MeasurementState.Name(held.header.measurement_state) == "MEASUREMENT_STATE_PREDICTED"
    (seen,) = detections[step].moving_object
    measured = run.detections[run.detections["step"] == step].iloc[0]
    sizes = (seen.base.dimension.length, seen.base.dimension.width)
    assert sizes == pytest.approx((measured.get("length_m", 4.7), measured.get("width_m", 1.9)))
    near = {v.id.value: v for v in truths[step].moving_object}[seen.header.ground_truth_id[0].value]
    assert np.hypot(near.base.position.x - host.base.position.x, near.base.position.y - host.base.position.y) < 16.0


def test_an_osi_reader_finds_lanes_and_the_lines_between_them(bent):
    pytest.importorskip("osi3", reason="the extra osi is not installed")
    from osi3.osi_lane_pb2 import LaneBoundary  # noqa: PLC0415

    run, (truths, _, _) = read_recorded_run(bent), osi_messages(bent)
    assert len(truths) == STEPS
    truth = truths[7]
    lanes, lines = {lane.id.value: lane for lane in truth.lane}, {line.id.value: line for line in truth.lane_boundary}
    assert (len(lanes), len(lines)) == (5, 6)
    vehicles = {vehicle.id.value: vehicle for vehicle in truth.moving_object}
    assert not set(lanes) & set(lines) | set(lanes) & set(vehicles) | set(lines) & set(vehicles)
    kinds = [LaneBoundary.Classification.Type.Name(line.classification.type) for line in lines.values()]
    assert sorted(kinds) == ["TYPE_DASHED_LINE"] * 4 + ["TYPE_ROAD_EDGE"] * 2
    leftmost = next(lane for lane in lanes.values() if not lane.classification.left_adjacent_lane_id)
    order = [leftmost]
    while order[-1].classification.right_adjacent_lane_id:
        below = order[-1].classification
        order.append(lanes[below.right_adjacent_lane_id[0].value])
        assert order[-1].classification.left_lane_boundary_id == below.right_lane_boundary_id
        assert order[-1].classification.left_adjacent_lane_id[0].value == order[-2].id.value
    for lane, ours in zip(order, sorted(run.road.lanes, key=lambda lane: lane.number), strict=True):
        left = [point.position for point in lines[lane.classification.left_lane_boundary_id[0].value].boundary_line]
        for points, wanted in ((lane.classification.centerline, ours.centre_m), (left, ours.left_m)):
            x, y = np.array([[point.x, point.y] for point in points]).T
            assert len(x) >= 2
            # Between two points too, where the road bends.
            x, y = (np.interp(np.linspace(0, len(x) - 1, 300), range(len(x)), values) for values in (x, y))
            lon, lat = run.road.to_road(x, y)
            np.testing.assert_allclose(lat, wanted, atol=0.05)
            assert (np.diff(lon) > 0.0).all()
            assert lon[0] < 101.0
            assert lon[-1] > 460.0
    host = vehicles[truth.host_vehicle_id.value]
    (assigned,) = host.moving_object_classification.assigned_lane_id
    assert [lane.id.value for lane in order if lane.classification.is_host_vehicle_lane] == [assigned.value]
    assert order.index(lanes[assigned.value]) == 3  # 5 m from the right edge: lane 4


def with_tentative_tracks(folder):
    """Let all tracks of one step be tentative, and return the tracks."""
    tracks = pd.read_parquet(folder / "tracks.parquet").astype({"state": object})
    tracks.loc[tracks["step"] == GIVEN_UP - 1, "state"] = "tentative"
    rewrite(folder, "tracks.parquet", tracks)
    return tracks


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "needed"), [("osi", "osi3"), ("mcap", "mcap"), ("autoware", "mcap"), ("mot", "numpy")]
)
def test_tentative_tracks_are_exported_as_if_they_were_not_there(name, needed, folder, tmp_path):
    pytest.importorskip(needed, reason=f"the extra of {name} is not installed")
    tracks, written = with_tentative_tracks(folder), []
    for part in (tracks, tracks[tracks["state"] != "tentative"]):
        rewrite(folder, "tracks.parquet", part)
        written.append([file.read_bytes() for file in export_run(folder, name, tmp_path / "out", force=True)])
    assert written[0] == written[1]


def test_curves_tell_how_far_off_the_followed_vehicles_are(folder):
    curves = curves_of(read_recorded_run(folder))
    assert len(curves.time_s) == STEPS
    np.testing.assert_allclose(curves.error_m["seen"][5:LAST_SEEN], 0.1, atol=1e-6)
    hidden = curves.error_m["hidden"]
    np.testing.assert_allclose(hidden[LAST_SEEN + 1 : GIVEN_UP], 3.0, atol=1e-6)
    assert np.isnan(hidden[GIVEN_UP:SEEN_AGAIN]).all()
    assert curves.count["hidden vehicles"][25] == curves.count["seen vehicles"][25] == 1
    assert (curves.count["tracks"][25], curves.count["tracks taken for hidden"][25]) == (2, 1)
    assert curves.count["detections"][[0, 25]].tolist() == [2, 1]


@pytest.mark.slow
def test_rerun_reads_its_recording_with_curves_and_a_layout(folder):
    pytest.importorskip("rerun", reason="the extra viewer is not installed")
    with_tentative_tracks(folder)
    (file,) = export_run(folder, "rerun")
    command = [sys.executable, "-m", "rerun", "rrd", "print", str(file)]
    text = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    # Names and colours of curves stand in rows of their own.
    rows: dict[str, int] = {}
    for count, entity in re.findall(r"with (\d+) rows .*? - /([\w/]+) - data", text):
        rows[entity] = max(int(count), rows.get(entity, 0))
    assert {"truth": STEPS, "detections": STEPS, "tracks": STEPS - 1, "road": 1}.items() <= rows.items()
    assert rows["curves/count/tracks"] == STEPS
    assert rows["curves/error_m/hidden"] == GIVEN_UP - LAST_SEEN - 1
    assert re.search(r"BlueprintActivationCommand\(.*make_default: true", text)
    assert text.count("ViewBlueprint:class_identifier") == 3
    assert "EyeControls3D:tracking_entity" in text


def test_an_mcap_reader_finds_boxes_of_vehicles_detections_and_tracks(bent):
    pytest.importorskip("foxglove_schemas_protobuf", reason="the extra mcap is not installed")
    from mcap.reader import make_reader  # noqa: PLC0415
    from mcap_protobuf.decoder import DecoderFactory  # noqa: PLC0415

    (file,) = export_run(bent, "mcap")
    before = file.read_bytes()
    assert export_run(bent, "mcap") == [file]
    assert file.read_bytes() == before
    run = read_recorded_run(bent)
    by_topic: dict[str, list] = {}
    schemas = {}
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            decoder = DecoderFactory().decoder_for(channel.message_encoding, schema) or json.loads
            by_topic.setdefault(channel.topic, []).append((message.log_time, decoder(message.data)))
            schemas[channel.topic] = schema.name
    scene = "foxglove.SceneUpdate"
    assert schemas == {
        **dict.fromkeys(("/road", "/truth", "/detections", "/tracks"), scene),
        "/tf": "foxglove.FrameTransform",
        "/curves": "harness.Curves",
    }
    assert {topic: len(found) for topic, found in by_topic.items()} == dict.fromkeys(schemas, STEPS) | {"/road": 1}
    step = GIVEN_UP - 1
    assert by_topic["/truth"][step][0] == round(1e8 * step)
    (truth, detections, tracks) = (by_topic[topic][step][1].entities for topic in ("/truth", "/detections", "/tracks"))
    assert {entity.id for entity in truth} == {"ego", "near", "far", "distant"}
    assert (len(detections), {entity.id for entity in tracks}) == (1, {"1", "2"})
    far = next(entity for entity in truth if entity.id == "far")
    row = run.truth[(run.truth["step"] == step) & (run.truth["vehicle_id"] == "far")]
    (x,), (y,), (heading,) = run.in_plane(row)
    (box,) = far.cubes
    assert (box.pose.position.x, box.pose.position.y) == pytest.approx((x, y))
    assert 2.0 * np.arctan2(box.pose.orientation.z, box.pose.orientation.w) == pytest.approx(heading)
    assert (box.size.x, box.size.y) == (4.5, 1.8)
    assert {pair.key: pair.value for pair in far.metadata}["state"] == "hidden"
    assert (far.frame_id, far.lifetime.nanos) == ("map", 100_000_000)
    transform = by_topic["/tf"][step][1]
    ego = next(entity for entity in truth if entity.id == "ego").cubes[0].pose
    assert (transform.translation.x, transform.translation.y) == (ego.position.x, ego.position.y)
    assert (transform.rotation.z, transform.rotation.w) == (ego.orientation.z, ego.orientation.w)
    held = next(entity for entity in tracks if entity.id == "2")
    ahead = np.hypot(held.cubes[0].pose.position.x - x, held.cubes[0].pose.position.y - y)
    assert ahead == pytest.approx(3.0, abs=0.1)
    assert held.texts[0].text == "2"
    assert len(by_topic["/road"][0][1].entities[0].lines) == 6
    curves = by_topic["/curves"][step][1]
    assert (curves["error_hidden_m"], curves["tracks"]) == (3.0, 2)
    assert "error_hidden_m" not in by_topic["/curves"][GIVEN_UP][1]


@pytest.mark.parametrize(("name", "package"), [("mcap", "foxglove_schemas_protobuf"), ("osi", "osi3")])
def test_a_format_whose_extra_is_missing_names_it(name, package, folder, monkeypatch):
    for module in [module for module in sys.modules if module.startswith((package, "harness.export."))]:
        if module != "harness.export.formats":
            monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf"^`to`: {name} needs {package}.*-c constraints.txt '\.\[{name}\]'"):
        export_run(folder, name)


@pytest.mark.slow
def test_the_film_has_a_picture_for_each_step_and_one_that_fails_leaves_nothing(folder, tmp_path, monkeypatch):
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="the extra video is not installed")
    film = write_video(folder, tmp_path / "run.mp4")
    assert ffmpeg.count_frames_and_secs(str(film)) == (STEPS, pytest.approx(STEPS * 0.1, abs=0.1))
    with pytest.raises(InputError, match="`force`"):
        write_video(folder, film)
    monkeypatch.delattr(video, "scene_figure")
    with pytest.raises(NameError):
        write_video(folder, film, force=True)
    assert not [*tmp_path.glob(".*")]


def test_the_pictures_of_a_film_are_of_one_size_and_show_tracks_where_they_are(folder):
    run = read_recorded_run(folder)
    moved = replace(run, tracks=run.tracks.assign(lon_m=run.tracks["lon_m"] + 5.0 * (run.tracks["step"] == 2)))
    pictures, others = ([*itertools.islice(video.drawn_steps(each), 4)] for each in (run, moved))
    assert len({picture.shape for picture in pictures}) == 1
    assert [np.array_equal(*both) for both in zip(pictures, others, strict=True)] == [True, True, False, True]


def test_a_film_that_cannot_be_written_is_refused_before_the_run(tmp_path, capsys):
    begun = tmp_path / "run"
    assert run_command_line(["run", "--out", str(begun), "--video", str(tmp_path / "run.avi")]) == WRONG_INPUT
    assert "must end in .mp4" in capsys.readouterr().err
    assert not begun.exists()


def test_an_export_is_replaced_as_a_whole_and_a_given_folder_only_by_force(folder, tmp_path):
    said: list[str] = []
    export_run(folder, "csv", tell=said.append)
    assert not said
    (folder / "export" / "csv" / "truth.csv").write_text("stale")
    export_run(folder, "csv", tell=said.append)
    assert "an export, 6 files" in said[0]
    assert (folder / "export" / "csv" / "truth.csv").read_text() != "stale"
    out = tmp_path / "out"
    export_run(folder, "csv", out)
    with pytest.raises(InputError, match="`force`"):
        export_run(folder, "fcd", out)
    export_run(folder, "fcd", out, force=True)
    assert not list(out.glob("*.csv"))
    assert not [*tmp_path.rglob("*.running-*"), *tmp_path.rglob(f"*{LOCK}")]


def test_no_export_removes_a_file_that_no_export_has_written(folder, tmp_path):
    out = tmp_path / "mine"
    out.mkdir()
    (out / "thesis.tex").write_text("x")
    for force in (False, True):
        with pytest.raises(InputError, match="`out`"):
            export_run(folder, "csv", out, force=force)
    export_run(folder, "csv")
    (folder / "export" / "csv" / "notes.txt").write_text("x")
    with pytest.raises(InputError, match=r"holds notes\.txt, which this program did not write"):
        export_run(folder, "csv")
    with pytest.raises(InputError, match="is a run, not an export"):
        export_run(folder, "csv", folder, force=True)
    assert (out / "thesis.tex").exists()
    assert (folder / "export" / "csv" / "notes.txt").exists()


def test_an_export_that_finds_no_room_leaves_the_earlier_one(folder, monkeypatch):
    files = export_run(folder, "csv")
    before = files[0].read_bytes()

    def full(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("harness.export.csv_tables.csv.write_csv", full)
    with pytest.raises(RunError, match="No space left"):
        export_run(folder, "csv")
    assert files[0].read_bytes() == before
    assert [path.name for path in (folder / "export").iterdir()] == ["csv"]


def test_the_command_lists_the_files_and_refuses_what_it_does_not_know(folder, tmp_path, capsys):
    assert run_command_line(["export", str(folder), "--to", "mot", "--json"]) == 0
    files = json.loads(capsys.readouterr().out)["files"]
    assert any(file.endswith("gt.txt") for file in files)
    for wrong in (["--to", "kitti"], [], ["--video", str(tmp_path / "run.avi")]):
        assert run_command_line(["export", str(folder), *wrong]) == WRONG_INPUT
        assert capsys.readouterr().err.count("\n") == 1
    assert run_command_line(["export", str(tmp_path), "--to", "csv"]) == WRONG_INPUT
    (tmp_path / "runs.parquet").touch()
    assert run_command_line(["export", str(tmp_path), "--to", "csv"]) == WRONG_INPUT
    assert "holds many runs, which only mlflow and trackio take" in capsys.readouterr().err
