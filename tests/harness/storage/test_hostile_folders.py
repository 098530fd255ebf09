"""Run folders of others: measured before they are read, and no name in them is a path."""

import json
import os
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from harness.commands.app import run_command_line
from harness.common.errors import InputError
from harness.export.csv_tables import export as export_csv
from harness.export.fcd import export as export_fcd
from harness.export.mot import folder_name
from harness.running.finished import read_recorded_run
from harness.storage.run_folder import read_table
from tests.harness.recorded_scene import metrics_of, write_recorded_scene

pytestmark = pytest.mark.usefixtures("no_pictures")

READERS = (["report", "scene"], ["export", "scene", "--to", "mot"], ["run", "--replay", "scene", "--out", "out"])


@pytest.fixture
def scene(tmp_path) -> Path:
    return write_recorded_scene(tmp_path / "scene")


@pytest.mark.slow
@pytest.mark.parametrize(
    "table",
    [
        pa.table({"step": np.zeros(60_000_000)}),
        pa.table({"state": pa.DictionaryArray.from_arrays(pa.array(np.zeros(17_000_000, dtype=np.int32)), ["x"])}),
        pa.table({"vehicle_id": pa.DictionaryArray.from_arrays(pa.array([0] * 1_000_000), pa.array(["x" * 100_000]))}),
    ],
)
def test_a_small_file_of_a_table_that_fills_the_memory_is_refused(table, tmp_path, monkeypatch):
    pq.write_table(table, tmp_path / "truth.parquet", store_schema=False, compression="zstd")
    assert (tmp_path / "truth.parquet").stat().st_size < 1_000_000
    monkeypatch.setattr("harness.common.isolation.ProcessLimits.memory_bytes", 256 << 20)
    with pytest.raises(InputError, match=r"truth\.parquet needs more memory than is allowed"):
        read_table(tmp_path, "truth.parquet", "folder", ())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("at", "value"),
    [
        ("tracks track_id", np.nan), ("tracks existence", np.inf), ("detections lon_m", -1e300),
        ("truth time_s", np.nan), ("truth width_m", np.inf), ("truth heading_rad", -1e300),
    ],
)  # fmt: skip
def test_identities_times_and_places_that_none_can_have_are_refused(at, value, scene, refused):
    table, column = at.split()
    path = scene / f"{table}.parquet"
    rows = pd.read_parquet(path)
    rows[column] = rows[column].astype("float64").where(rows.index != 3, value)
    rows.to_parquet(path)
    for words in (READERS[0], *(["export", "scene", "--to", to, "--out", "out"] for to in ("csv", "fcd"))):
        assert f"{column} of row" in refused(*words)


@pytest.mark.parametrize(
    ("table", "words"), [("truth", READERS[0]), ("detections", READERS[2]), ("tracks", READERS[1])], ids=str
)
@pytest.mark.parametrize("shuffled", [False, True])
def test_a_table_that_lost_rows_or_has_them_in_another_order_is_refused(shuffled, table, words, scene, refused):
    path = scene / f"{table}.parquet"
    rows = pd.read_parquet(path)
    (rows.sample(frac=1.0, random_state=1) if shuffled else rows[: len(rows) // 2]).to_parquet(path)
    lost = f" has {len(rows) // 2} rows, the run wrote {len(rows)}"
    fault = ": its rows are not in the order of time" if shuffled else lost
    assert f"{table}.parquet{fault}" in refused(*words)


@pytest.mark.slow
def test_detections_that_were_left_out_on_purpose_are_replayed_once_the_manifest_no_longer_counts_them(scene, refused):
    path = scene / "detections.parquet"
    pd.read_parquet(path)[::2].to_parquet(path)
    words = [*READERS[2], "--quiet", "--tracker", "tests.harness.stand_ins:echo_tracker"]
    assert "or take rows out of manifest.json" in refused(*words)
    manifest = json.loads((scene / "manifest.json").read_text())
    del manifest["rows"]
    (scene / "manifest.json").write_text(json.dumps(manifest))
    assert run_command_line(words) == 0


CHANGES = {
    "an unknown state": lambda truth: truth.assign(state="flying"),
    "texts for numbers": lambda truth: truth.assign(lon_m="far"),
    "numbers for texts": lambda truth: truth.assign(vehicle_id=5),
    "no ego": lambda truth: truth.assign(is_ego=False),
    "vehicles without width": lambda truth: truth.assign(width_m=0.0),
    "a vehicle twice": lambda truth: pd.concat([truth, truth]),
    "time running back": lambda truth: truth.assign(time_s=-truth["time_s"]),
    "nothing": lambda truth: truth.iloc[:0],
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_a_replay_of_a_changed_truth_is_refused_before_it_begins(change, scene, refused):
    change(pd.read_parquet(scene / "truth.parquet")).to_parquet(scene / "truth.parquet")
    refused(*READERS[2])
    assert not list(scene.parent.glob("*out*"))


@pytest.mark.parametrize("words", READERS, ids=lambda words: words[0])
@pytest.mark.parametrize("name", ["truth.parquet", "road.json", "config.toml", "manifest.json"])
@pytest.mark.parametrize("damage", ["pipe", "missing", "empty", "deep"])
def test_a_damaged_file_of_a_folder_is_told_in_one_line(words, name, damage, scene, refused):
    (scene / name).unlink()
    if damage == "pipe":
        os.mkfifo(scene / name)
    elif damage != "missing":
        (scene / name).write_text("" if damage == "empty" else "[" * 100_000)
    if name == "config.toml" and damage == "empty":
        return  # an empty configuration is one of defaults
    refused(*words)


@pytest.mark.slow
def test_a_road_that_nobody_can_drive_on_is_refused(scene, refused):
    road = json.loads((scene / "road.json").read_text())
    for change in (
        {"lanes": []}, {"reference_xy": [[0, 0]]}, {"reference_xy": [[0, 0], [0, 0]]}, {"section_m": [5, 5]},
        {"reference_start_m": float("nan")}, {"lanes": [{**road["lanes"][0], "left_m": -1e3}]}, {"lanes": 7},
        {"lanes": [{**road["lanes"][0], "left_m": road["lanes"][0]["right_m"] + 1e-300}]},
        {"lanes": [{**road["lanes"][0], "left_m": road["lanes"][0]["right_m"] + 0.1}]},
    ):  # fmt: skip
        (scene / "road.json").write_text(json.dumps(road | change))
        assert "road.json" in refused(*READERS[2])


@pytest.mark.parametrize(
    "name", ["../../../up", "/tmp/absolute", "..", ".hidden", "a/b", "", "x" * 400, "package.module:f"]
)
def test_no_name_of_a_tracker_is_a_path(name, tmp_path):
    made = folder_name(name)
    assert made
    assert Path(made).name == made
    assert not made.startswith(".")
    (tmp_path / made).mkdir()


FIGURES = [*READERS[0], "--figures", "svg"]


@pytest.mark.parametrize(
    ("link", "target", "words"),
    [
        ("report.html", "file", READERS[0]), ("figures", "", FIGURES), ("figures/failure-1.svg", "file", FIGURES),
        ("export", "", READERS[1]),
    ],
)  # fmt: skip
def test_nothing_is_written_through_a_link_in_a_folder(link, target, words, scene, tmp_path, refused):
    (tmp_path / "outside").mkdir()
    (scene / link).parent.mkdir(exist_ok=True)
    (scene / link).symlink_to(tmp_path / "outside" / target)
    assert f"{link} is a link" in refused(*words)
    assert not list((tmp_path / "outside").iterdir())


def test_no_name_in_a_folder_steers_the_terminal(scene, capsys):
    (scene / (name := "a\x1b[2J\x9b2J")).write_text("")
    metrics = metrics_of(scene)
    (scene / "metrics.json").write_text(json.dumps(metrics | {"run": metrics["run"] | {"tracker": name}}))
    manifest = json.loads((scene / "manifest.json").read_text())
    for words, noted in ((["compare", str(scene), str(scene)], {}), (["report", str(scene)], {name: "another"})):
        (scene / "manifest.json").write_text(json.dumps(manifest | {"files_sha256": noted}))
        assert run_command_line(words) == 0
        told = capsys.readouterr().err
        assert "a?[2J?2J" in told
        assert not {"\x1b", "\x9b"} & set(told)


def test_a_folder_named_like_that_of_a_user_is_in_the_working_folder(scene, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["score", "--truth", str(scene), "--tracks", str(scene), "--quiet", "--out"]
    assert run_command_line([*words, "~/x"]) == 0
    assert run_command_line(["report", "~/x"]) == 0
    assert (tmp_path / "~" / "x" / "report.html").is_file()


def test_an_exported_run_stays_within_its_folder(scene, tmp_path, capsys):
    config = (scene / "config.toml").read_text()
    (scene / "config.toml").write_text(config.replace('name = "mmpf"', 'name = "../../../../escaped"'))
    assert run_command_line(["export", str(scene), "--to", "mot", "--out", str(tmp_path / "mot")]) == 0
    assert not list(tmp_path.glob("**/escaped/data"))[1:]
    assert all(path.is_relative_to(tmp_path / "mot") for path in tmp_path.glob("**/*escaped*"))


@pytest.mark.slow
def test_names_with_control_characters_make_valid_xml_and_no_formulas(tmp_path):
    names = {"near": "a\x01b", "far": "=SUM(A1:A9)", "distant": "-12.5"}
    run = read_recorded_run(write_recorded_scene(tmp_path / "scene", names))
    written = next(file for file in export_fcd(run, tmp_path) if file.name == "fcd.xml")
    assert {"a%01b", "=SUM(A1:A9)"} <= {node.get("id") for node in ElementTree.parse(written).iter("vehicle")}
    tables = {path.name: path for path in export_csv(run, tmp_path)}
    truth = pd.read_csv(tables["truth.csv"], dtype=str)
    assert {"'=SUM(A1:A9)", "-12.5"} <= set(truth["vehicle_id"])
