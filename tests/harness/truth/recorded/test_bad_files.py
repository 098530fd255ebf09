"""Files that are no recording, or one that nobody drove: refused at once, in one line that names the file."""

import os
import re
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pytest

from harness.common.errors import InputError
from harness.common.untrusted_files import number
from harness.truth.recorded.fcd import read_fcd
from harness.truth.recorded.source import open_recorded_traffic
from tests.harness.truth.recorded.layouts import (
    NGSIM_HEADER,
    edited,
    ngsim_rows,
    opened,
    write_commonroad,
    write_fcd,
    write_highd,
    write_ngsim_csv,
    write_ngsim_text,
)

FRAME, TIME, LAT, LON, LENGTH, WIDTH, SPEED = 1, 3, 4, 5, 8, 9, 11
EVERY = slice(None)


def ngsim(columns: int | tuple[int, ...], change: Callable[[float], object], rows: slice = EVERY):
    """Return what writes a recording with some columns of some rows changed."""

    def write(path: Path) -> None:
        table = ngsim_rows()
        for row in table[rows]:
            for column in (columns,) if isinstance(columns, int) else columns:
                row[column] = change(row[column])
        write_ngsim_csv(path, table)

    return write


def metres(feet: float) -> float:
    return 0.3048 * feet


def huge_binary(path: Path) -> None:
    path.write_bytes(b"\x7fELF\x02\x01\x01")
    os.truncate(path, 1 << 30)


def without_a_column(path: Path) -> None:
    kept = [place for place, name in enumerate(NGSIM_HEADER.split(",")) if name != "Local_Y"]
    rows = [[[*row, "us-101"][place] for place in kept] for row in ngsim_rows()]
    write_ngsim_csv(path, rows, ",".join(NGSIM_HEADER.split(",")[place] for place in kept))


def cut(write: Callable[[Path], Path], share: float = 0.6) -> Callable[[Path], None]:
    return lambda path: os.truncate(write(path), int(path.stat().st_size * share))


def standing(time_steps: str) -> str:
    return (
        '<staticObstacle id="900"><type>parkedVehicle</type><shape><rectangle><length>4</length><width>2</width>'
        "</rectangle></shape><initialState><position><point><x>0</x><y>0</y></point></position><orientation><exact>0</exact>"
        f"</orientation><time><exact>{time_steps}</exact></time></initialState></staticObstacle>"
    )


def late_obstacle(path: Path) -> None:
    write_commonroad(path, extra=standing("0"))
    text = path.read_text()
    path.write_text(re.sub(r"<exact>50</exact>(?=</time>)", "<exact>2000000000</exact>", text))


NO_RECORDING: dict[str, Callable[[Path], object]] = {
    "nothing": Path.touch,
    "a huge binary": huge_binary,
    "prose": lambda path: path.write_text("It was a bright cold day in April.\n" * 50),
    "other XML": lambda path: path.write_text("<?xml version='1.0'?><net><edge/></net>"),
    "a column missing": without_a_column,
    "a column of text missing": lambda path: write_ngsim_text(path, [row[:-1] for row in ngsim_rows()]),
    "the last row cut": edited(write_ngsim_csv, r".{40}\Z", ""),
    "CommonRoad cut": cut(write_commonroad),
    "CommonRoad cut in its head": cut(write_commonroad, 0.1),
    "floating-car data cut": cut(write_fcd),
    "CommonRoad of another version": lambda path: write_commonroad(path, version="2017a"),
    "no lanelets": edited(write_commonroad, "(</?)lanelet(?=[ >])", r"\1other"),
    "highD without meta data": lambda path: (write_highd(path) / "01_tracksMeta.csv").unlink(),
    "highD without a column": edited(write_highd, "xVelocity", "speed", 1, "01_tracks.csv"),
}
NO_TRAFFIC: dict[str, Callable[[Path], object]] = {
    "a word for a number": ngsim(LON, lambda value: "far", slice(17, 18)),
    "a number missing": ngsim(LON, lambda value: "", slice(17, 18)),
    "a vehicle's positions in metres": ngsim((LAT, LON), metres, slice(51, 102)),
    "positions in metres from some row on": ngsim((LAT, LON), metres, slice(30, 51)),
    "everything in metres": ngsim((LAT, LON, LENGTH, WIDTH, SPEED), metres),
    "sizes in metres": ngsim((LENGTH, WIDTH), metres, slice(20, 40)),
    "time runs back": ngsim(TIME, lambda value: value - 1500, slice(20, 30)),
    "time and frames run back": lambda path: write_ngsim_csv(
        path, [*ngsim_rows()[:20], *ngsim_rows()[20:30][::-1], *ngsim_rows()[30:]]
    ),
    "time stands still": ngsim(TIME, lambda value: value - 100, slice(20, 21)),
    "fcd time runs back": edited(write_fcd, 'time="2.00"', 'time="1.20"'),
    "CommonRoad's time runs back": edited(write_commonroad, "<time><exact>20</exact>", "<time><exact>11</exact>", 1),
    "fcd in degrees": edited(write_fcd, ' x="', ' x="0.0'),
    "width 0": ngsim(WIDTH, lambda value: 0.0),
    "width negative": ngsim(WIDTH, lambda value: -value),
    "width nan": ngsim(WIDTH, lambda value: "nan"),
    "width 1e9": ngsim(WIDTH, lambda value: 1e9),
    "speeds negated": ngsim(SPEED, lambda value: -value),
    "speed infinite": ngsim(SPEED, lambda value: "inf"),
    "positions reversed": ngsim(LON, lambda value: 2000.0 - value),
    "150 m off the road": ngsim(LAT, lambda value: value + 500.0),
    "positions far away": ngsim(LON, lambda value: value + 1e12),
    "time step 0": edited(write_commonroad, 'timeStepSize="0.1"', 'timeStepSize="0"'),
    "time step negative": edited(write_commonroad, 'timeStepSize="0.1"', 'timeStepSize="-1"'),
    "time step huge": edited(write_commonroad, 'timeStepSize="0.1"', 'timeStepSize="1e9"'),
    "a time of two thousand million": late_obstacle,
    "lanelet far away": edited(write_commonroad, r"<x>[^<]*</x>", "<x>1e15</x>", 1),
    "fcd length infinite": edited(write_fcd, r'length="[^"]*"', 'length="inf"', 1),
    "fcd width 0": edited(write_fcd, r'width="[^"]*"', 'width="0"'),
    "fcd speed infinite": edited(write_fcd, r'speed="[^"]*"', 'speed="inf"', 1),
    "width in Python's spelling": ngsim(WIDTH, lambda value: "1_0"),
    "fcd width in Python's spelling": edited(write_fcd, r'width="[^"]*"', 'width="1_0"', 1),
    "fcd place in Python's spelling": edited(write_fcd, r' y="[^"]*"', ' y="1_0"', 1),
    "fcd time in another script's digits": edited(write_fcd, r'time="0.00"', 'time="\u0660"', 1),
    "a size in Python's spelling": edited(write_commonroad, "<length>[^<]*</length>", "<length>1_0</length>", 1),
    "a time step in Python's spelling": edited(write_commonroad, 'timeStepSize="0.1"', 'timeStepSize="0_0.1"'),
    "a column twice": edited(write_ngsim_csv, "Space_Headway", "Local_Y", 1),
    "fcd time nan": edited(write_fcd, r'time="[^"]*"', 'time="nan"', 1),
}


@pytest.mark.parametrize("name", NO_TRAFFIC)
def test_what_is_no_traffic_is_refused_in_one_line(name, tmp_path):
    path = tmp_path / "recording"
    NO_TRAFFIC[name](path)
    with pytest.raises(InputError, match="recording"):
        opened(path, duration_s=10.0)


@pytest.mark.parametrize("name", NO_RECORDING)
def test_the_command_refuses_it_in_one_line_and_leaves_nothing(name, tmp_path, refused):
    NO_RECORDING[name](tmp_path / "file")
    assert "file" in refused("run", "--replay", "file", "--tracker", "tests.harness.stand_ins:echo_tracker")
    assert not (tmp_path / "results").exists() or not list((tmp_path / "results").iterdir())


@pytest.mark.slow
def test_a_gigabyte_of_noise_behind_a_good_head_is_refused_too(tmp_path, refused):
    path = write_ngsim_csv(tmp_path / "file")
    with path.open("ab") as file:
        file.write(os.urandom(1 << 20))
    os.truncate(path, 1 << 30)
    refused("run", "--replay", path)


@pytest.mark.parametrize("name", ["commonroad", "fcd", "highd", "ngsim-text", "ngsim"])
def test_a_forced_format_that_is_not_the_files_is_told(name, tmp_path, refused):
    path = write_fcd(tmp_path / "file") if name.startswith("ngsim") else write_ngsim_csv(tmp_path / "file")
    refused("run", "--replay", path, "--format", name)


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
def test_a_wrong_choice_for_a_recording_names_the_option(options, named, tmp_path, refused):
    path = write_ngsim_csv(tmp_path / "scene.csv")
    assert named in refused("run", "--replay", path, *options)
    if named in ("--ego", "--format"):
        assert named in refused("run", *options), "simulated traffic has neither"


def test_floating_car_data_on_a_network_of_many_roads_is_one_clear_line(tmp_path):
    net = Path(__file__).parents[1] / "network" / "nets" / "crossing.net.xml"
    (tmp_path / "own.sumocfg").write_text(f'<configuration><net-file value="{net}"/></configuration>')
    (tmp_path / "fcd.xml").write_text("<fcd-export/>")
    with pytest.raises(InputError, match="with a main road"):
        read_fcd(tmp_path / "fcd.xml", str(tmp_path / "own.sumocfg"))


@pytest.mark.parametrize("text", ["1_0", "\u0661", "nan", "inf", "1e400", "0x10", "", "x", "1,0"])
def test_a_number_of_a_file_is_one_that_every_program_reads_alike(text):
    with pytest.raises(ValueError, match="is not a number"):
        number(text)
    assert [number(good) for good in ("10", " -1.5e2 ", "+.5")] == [10.0, -150.0, 0.5]


UPPER, LOWER, RECORDING, TRACKS = "4.00;7.75;11.50;15.25", "20.00;23.75;27.50;31.25", "recordingMeta", "tracksMeta"
WRONG_META = [
    *((RECORDING, "\n1,25,", f"\n1,{rate},", r"frameRate|recordingMeta\.csv: broken, or no CSV")
      for rate in ("0", "nan", "-25", "1e9", "0x10", "2_5")),
    # Lanes that nobody drives on are checked too.
    *((RECORDING, UPPER, marks, "upperLaneMarkings is '")
      for marks in ("inf;7.75;11.50;15.25", "4.00;7.75;11.50;1_5.25", "4.00;7.75;11.50;1e400", "4")),
    *((RECORDING, LOWER, marks, "lowerLaneMarkings is '")
      for marks in ("20;;23.75", "20;23.75;27.5;-1e2", "20;20", "20;900", "31.25;27.5;23.75;20")),
    *((TRACKS, "\n7,2,", f"\n{row},", rf"01_tracksMeta\.csv: {column}")
      for row, column in (("nan,2", "id"), (",2", "id"), ("7.5,2", "id"), ("7,3", "drivingDirection"))),
]  # fmt: skip


@pytest.mark.parametrize(("file", "old", "new", "told"), [*WRONG_META, (RECORDING, UPPER, "", None)])
def test_meta_data_of_highd_are_a_cameras_lanes_in_order_and_vehicles_that_there_are(file, old, new, told, tmp_path):
    folder = tmp_path / "recording"
    edited(write_highd, re.escape(old), new, 1, f"01_{file}.csv")(folder)
    with pytest.raises(InputError, match=told) if told else nullcontext():
        assert open_recorded_traffic(folder, "highd", "recording", "auto", 10.0).expected_steps


@pytest.mark.parametrize(
    "words",
    [
        *([option, "pipe"] for option in ("--replay", "--config", "--model-file")),
        *([option, "x" * 300] for option in ("--replay", "--config", "--model-file", "--net", "--out")),
        *(["--set", f"{key}={value}"] for key in ("traffic.recording", "traffic", "tracker", "sensor")
          for value in ("5", "[]")),
    ],
    ids=lambda words: " ".join(words)[:40],
)  # fmt: skip
def test_a_pipe_a_name_too_long_and_a_value_in_a_tables_place_are_refused(words, refused):
    os.mkfifo("pipe")
    told = refused("run", *words)
    assert words[0] in told or words[1].partition("=")[0] in told
