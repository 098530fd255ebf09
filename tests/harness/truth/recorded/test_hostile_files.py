"""Recordings that are well-formed and none the less no traffic: refused in one line, before much memory is taken."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from harness.commands.app import run_command_line
from harness.common.errors import InputError
from harness.common.untrusted_files import number
from harness.truth.recorded.source import open_recorded_traffic
from tests.harness.truth.recorded.layouts import (
    ngsim_rows,
    write_commonroad,
    write_fcd,
    write_highd,
    write_ngsim_csv,
)

WIDTH, LENGTH, SPEED, LON, LAT = 9, 8, 11, 5, 4


def ngsim(column: int, change):
    def write(path: Path) -> str:
        rows = ngsim_rows()
        for row in rows:
            row[column] = change(row[column])
        write_ngsim_csv(path, rows)
        return "ngsim"

    return write


def edited(write, form: str, pattern: str, replacement: str, count: int = 0):
    def make(path: Path) -> str:
        write(path)
        text, changed = re.subn(pattern, replacement, path.read_text(), count=count)
        assert changed
        path.write_text(text)
        return form

    return make


def standing(time_steps: str) -> str:
    return (
        '<staticObstacle id="900"><type>parkedVehicle</type><shape><rectangle><length>4</length><width>2</width>'
        "</rectangle></shape><initialState><position><point><x>0</x><y>0</y></point></position><orientation><exact>0</exact>"
        f"</orientation><time><exact>{time_steps}</exact></time></initialState></staticObstacle>"
    )


def late_obstacle(path: Path) -> str:
    write_commonroad(path, extra=standing("0"))
    text = path.read_text()
    path.write_text(re.sub(r"<exact>50</exact>(?=</time>)", "<exact>2000000000</exact>", text))
    return "commonroad"


HOSTILE = {
    "width 0": ngsim(WIDTH, lambda value: 0.0),
    "width negative": ngsim(WIDTH, lambda value: -value),
    "width nan": ngsim(WIDTH, lambda value: "nan"),
    "width 1e9": ngsim(WIDTH, lambda value: 1e9),
    "speeds negated": ngsim(SPEED, lambda value: -value),
    "speed infinite": ngsim(SPEED, lambda value: "inf"),
    "positions reversed": ngsim(LON, lambda value: 2000.0 - value),
    "150 m off the road": ngsim(LAT, lambda value: value + 500.0),
    "positions far away": ngsim(LON, lambda value: value + 1e12),
    "time step 0": edited(write_commonroad, "commonroad", 'timeStepSize="0.1"', 'timeStepSize="0"'),
    "time step negative": edited(write_commonroad, "commonroad", 'timeStepSize="0.1"', 'timeStepSize="-1"'),
    "time step huge": edited(write_commonroad, "commonroad", 'timeStepSize="0.1"', 'timeStepSize="1e9"'),
    "a time of two thousand million": late_obstacle,
    "lanelet far away": edited(write_commonroad, "commonroad", r"<x>[^<]*</x>", "<x>1e15</x>", 1),
    "fcd length infinite": edited(write_fcd, "fcd", r'length="[^"]*"', 'length="inf"', 1),
    "fcd width 0": edited(write_fcd, "fcd", r'width="[^"]*"', 'width="0"'),
    "fcd speed infinite": edited(write_fcd, "fcd", r'speed="[^"]*"', 'speed="inf"', 1),
    "width in Python's spelling": ngsim(WIDTH, lambda value: "1_0"),
    "fcd width in Python's spelling": edited(write_fcd, "fcd", r'width="[^"]*"', 'width="1_0"', 1),
    "fcd place in Python's spelling": edited(write_fcd, "fcd", r' y="[^"]*"', ' y="1_0"', 1),
    "fcd time in another script's digits": edited(write_fcd, "fcd", r'time="0.00"', 'time="\u0660"', 1),
    "a size in Python's spelling": edited(
        write_commonroad, "commonroad", "<length>[^<]*</length>", "<length>1_0</length>", 1
    ),
    "a time step in Python's spelling": edited(
        write_commonroad, "commonroad", 'timeStepSize="0.1"', 'timeStepSize="0_0.1"'
    ),
    "fcd time nan": edited(write_fcd, "fcd", r'time="[^"]*"', 'time="nan"', 1),
}


@pytest.mark.parametrize("make", HOSTILE.values(), ids=HOSTILE.keys())
def test_what_no_traffic_is_is_refused_in_one_line(make, tmp_path):
    path = tmp_path / "recording"
    form = make(path)
    with pytest.raises(InputError, match="recording") as told:
        open_recorded_traffic(path, form, "us101" if form in ("ngsim", "fcd") else "recording", "auto", 10.0)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("rate", "accepted"),
    [("25", True), ("0", False), ("nan", False), ("-25", False), ("1e9", False), ("0x10", False), ("2_5", False)],
)
def test_a_frame_rate_is_a_cameras(rate, accepted, tmp_path):
    folder = write_highd(tmp_path / "recording")
    meta = folder / "01_recordingMeta.csv"
    meta.write_text(meta.read_text().replace("\n1,25,", f"\n1,{rate},"))
    if accepted:
        assert open_recorded_traffic(folder, "highd", "recording", "auto", 10.0).expected_steps
    else:
        with pytest.raises(InputError, match=r"frameRate|recordingMeta\.csv: broken CSV"):
            open_recorded_traffic(folder, "highd", "recording", "auto", 10.0)


@pytest.mark.parametrize("upper", ["inf;7.75;11.50;15.25", "4.00;7.75;11.50;1_5.25", "4.00;7.75;11.50;1e400", "4"])
def test_lane_markings_that_nobody_drives_between_are_checked_too(upper, tmp_path):
    folder = write_highd(tmp_path / "recording")
    meta = folder / "01_recordingMeta.csv"
    text = meta.read_text()
    meta.write_text(text.replace("4.00;7.75;11.50;15.25", upper))
    with pytest.raises(InputError, match=r"upperLaneMarkings is '"):
        open_recorded_traffic(folder, "highd", "recording", "auto", 10.0)
    meta.write_text(text.replace("4.00;7.75;11.50;15.25", ""))
    assert open_recorded_traffic(folder, "highd", "recording", "auto", 10.0).expected_steps


@pytest.mark.parametrize(
    ("row", "column"), [("nan,2", "id"), (",2", "id"), ("7.5,2", "id"), ("7,3", "drivingDirection")]
)
def test_meta_data_name_vehicles_and_directions_that_there_are(row, column, tmp_path):
    folder = write_highd(tmp_path / "recording")
    meta = folder / "01_tracksMeta.csv"
    meta.write_text(meta.read_text().replace("\n7,2,", f"\n{row},"))
    with pytest.raises(InputError, match=rf"01_tracksMeta\.csv: {column}"):
        open_recorded_traffic(folder, "highd", "recording", "auto", 10.0)


@pytest.mark.parametrize("text", ["1_0", "\u0661", "nan", "inf", "1e400", "0x10", "", "x", "1,0"])
def test_a_number_of_a_file_is_one_that_every_program_reads_alike(text):
    with pytest.raises(ValueError, match="is not a number"):
        number(text)
    assert [number(good) for good in ("10", " -1.5e2 ", "+.5")] == [10.0, -150.0, 0.5]


@pytest.mark.parametrize("markings", ["20;;23.75", "20;23.75;27.5;-1e2", "20;20", "20;900", "31.25;27.5;23.75;20"])
def test_lane_markings_are_in_order_and_lanes_as_wide_as_lanes(markings, tmp_path):
    folder = write_highd(tmp_path / "recording")
    meta = folder / "01_recordingMeta.csv"
    meta.write_text(meta.read_text().replace("20.00;23.75;27.50;31.25", markings))
    with pytest.raises(InputError, match=r"lowerLaneMarkings is '"):
        open_recorded_traffic(folder, "highd", "recording", "auto", 10.0)


@pytest.mark.parametrize("option", ["--replay", "--config", "--model-file"])
def test_a_pipe_is_refused_and_not_waited_for(option, tmp_path, capsys):
    os.mkfifo(tmp_path / "pipe")
    assert run_command_line(["run", option, str(tmp_path / "pipe"), "--out", str(tmp_path / "run")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("option", ["--replay", "--config", "--model-file", "--net", "--out"])
def test_a_name_that_is_too_long_is_told_in_one_line(option, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_command_line(["run", option, "x" * 300]) == 2
    told = capsys.readouterr().err
    assert option in told
    assert len(told.splitlines()) == 1


@pytest.mark.parametrize(
    "setting", ["traffic.recording=5", "traffic=5", "tracker=1", "sensor=[]", "traffic.recording=[]"]
)
def test_a_value_in_the_place_of_a_table_is_told_in_one_line(setting, tmp_path, capsys):
    assert run_command_line(["run", "--set", setting, "--out", str(tmp_path / "run")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
