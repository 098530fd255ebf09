"""Files that are no recording are refused at once, in one line that names the file."""

import os
import time
from pathlib import Path

import pytest

from harness.commands.app import run_command_line
from harness.common.errors import InputError
from harness.truth.recorded.fcd import read_fcd
from tests.harness.truth.recorded.layouts import (
    NGSIM_HEADER,
    ngsim_rows,
    write_commonroad,
    write_fcd,
    write_highd,
    write_ngsim_csv,
    write_ngsim_text,
)


def empty(folder: Path) -> Path:
    (folder / "file").touch()
    return folder / "file"


def huge_binary(folder: Path) -> Path:
    path = folder / "file"
    path.write_bytes(b"\x7fELF\x02\x01\x01")
    os.truncate(path, 1 << 30)
    return path


def huge_noise_behind_a_header(folder: Path) -> Path:
    path = write_ngsim_csv(folder / "file")
    with path.open("ab") as file:
        file.write(os.urandom(1 << 20))
    os.truncate(path, 1 << 30)
    return path


def prose(folder: Path) -> Path:
    (folder / "file").write_text("It was a bright cold day in April.\n" * 50)
    return folder / "file"


def other_xml(folder: Path) -> Path:
    (folder / "file").write_text("<?xml version='1.0'?><net><edge/></net>")
    return folder / "file"


def cut(path: Path, share: float = 0.6) -> Path:
    os.truncate(path, int(path.stat().st_size * share))
    return path


def column_missing(folder: Path) -> Path:
    names = NGSIM_HEADER.split(",")
    keep = [k for k, name in enumerate(names) if name != "Local_Y"]
    rows = [[[*row, "us-101"][k] for k in keep] for row in ngsim_rows()]
    return write_ngsim_csv(folder / "file", rows, ",".join(names[k] for k in keep))


def text_column_missing(folder: Path) -> Path:
    return write_ngsim_text(folder / "file", [row[:-1] for row in ngsim_rows()])


def row_cut(folder: Path) -> Path:
    path = write_ngsim_csv(folder / "file")
    path.write_text(path.read_text()[:-40])
    return path


def word_for_number(folder: Path) -> Path:
    rows = ngsim_rows()
    rows[17][5] = "far"
    return write_ngsim_csv(folder / "file", rows)


def number_missing(folder: Path) -> Path:
    rows = ngsim_rows()
    rows[17][5] = ""
    return write_ngsim_csv(folder / "file", rows)


def scaled(columns: tuple[int, ...], chosen: slice) -> list[list[object]]:
    rows = ngsim_rows()
    for row in rows[chosen]:
        for column in columns:
            row[column] = row[column] * 0.3048
    return rows


def some_positions_in_metres(folder: Path) -> Path:
    return write_ngsim_csv(folder / "file", scaled((4, 5), slice(51, 102)))


def positions_in_metres_from_some_row_on(folder: Path) -> Path:
    return write_ngsim_csv(folder / "file", scaled((4, 5), slice(30, 51)))


def everything_in_metres(folder: Path) -> Path:
    return write_ngsim_csv(folder / "file", scaled((4, 5, 8, 9, 11), slice(None)))


def sizes_in_metres(folder: Path) -> Path:
    return write_ngsim_csv(folder / "file", scaled((8, 9), slice(20, 40)))


def time_runs_back(folder: Path) -> Path:
    rows = ngsim_rows()
    for row in rows[20:30]:
        row[3] -= 1500
    return write_ngsim_csv(folder / "file", rows)


def time_and_frames_run_back(folder: Path) -> Path:
    rows = ngsim_rows()
    return write_ngsim_csv(folder / "file", [*rows[:20], *rows[20:30][::-1], *rows[30:]])


def time_stands_still(folder: Path) -> Path:
    rows = ngsim_rows()
    rows[20][3] = rows[19][3]
    return write_ngsim_csv(folder / "file", rows)


def fcd_time_runs_back(folder: Path) -> Path:
    path = write_fcd(folder / "file")
    path.write_text(path.read_text().replace('time="2.00"', 'time="1.20"'))
    return path


def commonroad_time_runs_back(folder: Path) -> Path:
    path = write_commonroad(folder / "file")
    path.write_text(path.read_text().replace("<time><exact>20</exact>", "<time><exact>11</exact>", 1))
    return path


def fcd_in_degrees(folder: Path) -> Path:
    path = write_fcd(folder / "file")
    lines = [line.replace(' x="', ' x="0.0') for line in path.read_text().splitlines()]
    path.write_text("\n".join(lines))
    return path


def commonroad_without_lanelets(folder: Path) -> Path:
    path = write_commonroad(folder / "file")
    path.write_text(path.read_text().replace("<lanelet ", "<other ").replace("</lanelet>", "</other>"))
    return path


def commonroad_of_another_version(folder: Path) -> Path:
    return write_commonroad(folder / "file", version="2017a")


def highd_without_meta(folder: Path) -> Path:
    write_highd(folder / "file")
    (folder / "file" / "01_tracksMeta.csv").unlink()
    return folder / "file"


def highd_without_a_column(folder: Path) -> Path:
    path = write_highd(folder / "file") / "01_tracks.csv"
    path.write_text(path.read_text().replace("xVelocity", "speed", 1))
    return path


BAD = (
    empty, huge_binary, prose, other_xml, column_missing, text_column_missing, row_cut, word_for_number,
    number_missing, some_positions_in_metres, positions_in_metres_from_some_row_on, everything_in_metres,
    sizes_in_metres, time_runs_back, time_and_frames_run_back, time_stands_still, fcd_time_runs_back,
    commonroad_time_runs_back, fcd_in_degrees, commonroad_without_lanelets, commonroad_of_another_version,
    highd_without_meta, highd_without_a_column,
    lambda folder: cut(write_commonroad(folder / "file")), lambda folder: cut(write_fcd(folder / "file")),
    lambda folder: cut(write_commonroad(folder / "file"), 0.1),
)  # fmt: skip


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that must be refused, and return what it says."""
    begin = time.perf_counter()
    code = run_command_line(arguments)
    taken_s = time.perf_counter() - begin
    out, err = capsys.readouterr()
    assert code == 2, err
    assert out == ""
    assert len(err.splitlines()) == 1, err
    assert "Traceback" not in err
    assert taken_s < 10.0
    return err


@pytest.mark.parametrize("make", BAD, ids=lambda make: make.__name__.strip("<>"))
def test_a_file_that_is_no_recording_is_refused_in_one_line(make, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = make(tmp_path)
    told = refused(["run", "--replay", str(path), "--tracker", "tests.harness.stand_ins:echo_tracker"], capsys)
    assert "file" in told
    assert not (tmp_path / "results").exists() or not list((tmp_path / "results").iterdir())


@pytest.mark.slow
def test_a_gigabyte_of_noise_behind_a_good_head_is_refused_too(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = huge_noise_behind_a_header(tmp_path)
    refused(["run", "--replay", str(path)], capsys)


@pytest.mark.parametrize("name", ["commonroad", "fcd", "highd", "ngsim-text", "ngsim"])
def test_a_forced_format_that_is_not_the_files_is_told(name, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write_fcd(tmp_path / "file") if name.startswith("ngsim") else write_ngsim_csv(tmp_path / "file")
    refused(["run", "--replay", str(path), "--format", name], capsys)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--ego", "4711"], "--ego"),
        (["--format", "kitti"], "--format"),
        (["--density", "20"], "density"),
        (["--demand", "free"], "demand"),
        (["--net", "nosuch"], "--net"),
    ],
)
def test_a_wrong_choice_for_a_recording_names_the_option(options, named, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write_ngsim_csv(tmp_path / "scene.csv")
    assert named in refused(["run", "--replay", str(path), *options], capsys)


@pytest.mark.parametrize("option", ["--ego", "--format"])
def test_simulated_traffic_refuses_the_options_of_recorded_traffic(option, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert option in refused(["run", option, "auto"], capsys)


def test_floating_car_data_on_a_network_of_many_roads_is_one_clear_line(tmp_path):
    net = Path(__file__).parents[1] / "network" / "nets" / "crossing.net.xml"
    (tmp_path / "own.sumocfg").write_text(f'<configuration><net-file value="{net}"/></configuration>')
    (tmp_path / "fcd.xml").write_text("<fcd-export/>")
    with pytest.raises(InputError, match="with a main road") as error:
        read_fcd(tmp_path / "fcd.xml", str(tmp_path / "own.sumocfg"))
    assert "\n" not in str(error.value)
