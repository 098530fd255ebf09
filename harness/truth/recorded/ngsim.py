"""NGSIM trajectories: the public CSV with its header, and the original text of 18 columns.

Feet and milliseconds. ``Local_Y`` runs along the section, ``Local_X`` from the left edge of lane 1 to the right; both
are those of the front bumper's middle. The stated accelerations are not used, see ``harness.truth.recorded.motion``.
"""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from harness.common.bounds import Numbers, check_columns, check_numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import reading, unpacked
from harness.truth.network.network import load_network
from harness.truth.recorded.rows import ReadTraffic, Rows, unknown
from harness.truth.sumo.reading import beside_the_road
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, StringArray

FOOT_M = 0.3048
COLUMNS = ("Vehicle_ID", "Frame_ID", "Global_Time", "Local_X", "Local_Y", "v_Length", "v_Width", "v_Vel")
TEXT_COLUMNS = (
    *("Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y", "Global_X", "Global_Y"),
    *("v_Length", "v_Width", "v_Class", "v_Vel", "v_Acc", "Lane_ID", "Preceding", "Following"),
    *("Space_Headway", "Time_Headway"),
)
LAST = TEXT_COLUMNS[-1]
ALLOWED = {"Vehicle_ID": Numbers(whole=True), "v_Vel": Numbers()}
"""What numbers may be that are not checked with those of all formats."""
FRAME_S, APART = 0.1, "Global_Time less Frame_ID, ms,"
NAME_USED_AGAIN_MS = 60_000.0
SITES = ("us101", "i80", "lankershim", "peachtree")

Columns = dict[str, FloatArray]


def read_ngsim_csv(path: Path, net: str) -> ReadTraffic:
    """Read the public CSV; if it has several sites, use the one with the network's name.

    Raises:
        InputError: A column is missing, a value is not a number, or no site is the network's.
    """
    with _text(path) as file:
        names = [name.strip().strip('"') for name in file.readline().split(",")]
    lower = {name.lower(): name for name in names}
    known = {name.lower(): name for name in COLUMNS}
    check_columns(path, [known.get(name.lower(), name) for name in names], COLUMNS)
    wanted = {name: lower[name.lower()] for name in COLUMNS}
    location = lower.get("location")
    table = _read_columns(path, wanted, location)
    columns = {name: table[source].to_numpy() for name, source in wanted.items()}
    if location is None:
        return _traffic(columns, path, net, {})
    return _of_one_site(columns, table[location], path, net)


def read_ngsim_text(path: Path, net: str) -> ReadTraffic:
    """Read the original text.

    Raises:
        InputError: It does not have 18 columns of numbers.
    """
    with _text(path) as file:
        found = len(next(line for line in file if line.strip()).split())
    if found != len(TEXT_COLUMNS):
        raise InputError(
            f"{path}: {found} columns where NGSIM's text has {len(TEXT_COLUMNS)}: {', '.join(TEXT_COLUMNS)}"
        )
    with reading(path, f"text of NGSIM of {len(TEXT_COLUMNS)} columns"), unpacked(path) as content:
        table = pd.read_csv(
            content, sep=r"\s+", header=None, names=list(TEXT_COLUMNS), usecols=[*COLUMNS, LAST], dtype=np.float64
        )
    check_numbers(path, table, {LAST: Numbers()}, lambda row: f"row {row + 1}, which is cut off,")
    return _traffic({name: table[name].to_numpy() for name in COLUMNS}, path, net, {})


def _read_columns(path: Path, wanted: dict[str, str], location: str | None) -> pa.Table:
    include = [*wanted.values(), *([location] if location is not None else [])]
    types: dict[str, pa.DataType] = dict.fromkeys(wanted.values(), pa.float64())
    if location is not None:
        types[location] = pa.dictionary(pa.int32(), pa.string())
    with suppress(pa.ArrowInvalid):
        return _read_csv(path, include, types)
    # Some exports group the digits of large numbers by commas.
    with reading(path, "CSV of NGSIM"):
        texts = _read_csv(path, include, dict.fromkeys(include, pa.string()))
        return pa.table(
            {
                name: texts[name]
                if name == location
                else pc.cast(pc.replace_substring(texts[name], ",", ""), pa.float64())
                for name in include
            }
        )


def _read_csv(path: Path, include: list[str], types: dict[str, pa.DataType]) -> pa.Table:
    options = pa.csv.ConvertOptions(
        include_columns=include, column_types=types, null_values=["", "NA", "NULL"], strings_can_be_null=True
    )
    with unpacked(path) as file:
        return pa.csv.read_csv(file, convert_options=options)


@contextmanager
def _text(path: Path) -> Iterator[TextIO]:
    with unpacked(path) as file:
        yield io.TextIOWrapper(file, encoding="utf-8-sig")


def _of_one_site(columns: Columns, location: pa.ChunkedArray, path: Path, net: str) -> ReadTraffic:
    sites = _plain(location)
    known = sorted(set(sites.tolist()) - {"None"})
    own_net = all(_letters(Path(net).name) != _letters(site) for site in SITES)
    if not known or (len(known) == 1 and (own_net or _letters(known[0]) not in map(_letters, SITES))):
        return _traffic(columns, path, net, {})
    wanted = [site for site in known if _letters(site) == _letters(Path(net).name)]
    if not wanted:
        raise InputError(
            f"{path}: it holds the sites {', '.join(known)}, none of which is the network {net}; give `net`"
        )
    of_site = sites == wanted[0]
    others = len(set(zip(sites[~of_site].tolist(), columns["Vehicle_ID"][~of_site].tolist(), strict=True)))
    chosen = {name: values[of_site] for name, values in columns.items()}
    return _traffic(chosen, path, net, {f"at another site than {wanted[0]}": others})


def _plain(location: pa.ChunkedArray) -> npt.NDArray[np.str_]:
    encoded = location.combine_chunks()
    if not pa.types.is_dictionary(encoded.type):
        encoded = encoded.dictionary_encode()
    names = np.array([*map(str, encoded.dictionary.to_pylist()), "None"])
    index = pc.fill_null(encoded.indices, len(names) - 1).to_numpy(zero_copy_only=False)
    return names[np.asarray(index, dtype=np.int64)]


def _traffic(columns: Columns, path: Path, net: str, left_out: dict[str, int]) -> ReadTraffic:
    road = load_network(net).road
    _check_clock(columns, path)
    check_numbers(path, columns, ALLOWED)
    distinct, vehicle = np.unique(columns["Vehicle_ID"].astype(np.int64), return_inverse=True)
    names = distinct.astype(np.str_)
    length_m, width_m = columns["v_Length"] * FOOT_M, columns["v_Width"] * FOOT_M
    left_edge_m = max(lane.left_m for lane in road.lanes)
    count = len(vehicle)
    rows = Rows(
        vehicle=vehicle.astype(np.int64),
        time_s=columns["Global_Time"] / 1e3,
        lon_m=road.section_m[0] + columns["Local_Y"] * FOOT_M - 0.5 * length_m,
        lat_m=left_edge_m - columns["Local_X"] * FOOT_M,
        heading_rad=unknown(count),
        speed_mps=columns["v_Vel"] * FOOT_M,
        lat_speed_mps=unknown(count),
        length_m=length_m,
        width_m=width_m,
    )
    _check_places(rows, road, names, path, net)
    return ReadTraffic(road, names, rows, len(names) + sum(left_out.values()), left_out)


def _check_places(rows: Rows, road: Road, names: StringArray, path: Path, net: str) -> None:
    """Refuse a recording of which more than one vehicle in a hundred never comes near the network's road."""
    near = np.bincount(rows.vehicle[beside_the_road(road, rows.lat_m)], minlength=len(names)) > 0
    if np.sum(~near) > 0.01 * len(names):
        far = names[np.flatnonzero(~near)[0]]
        raise InputError(
            f"{path}: {int(np.sum(~near))} vehicles, {far} among them, are never within 15 m of the road of {net}; "
            "name the network that was recorded, or fix Local_X"
        )


def _check_clock(columns: Columns, path: Path) -> None:
    """Refuse a file whose two clocks, frames and milliseconds, disagree from one row of a vehicle to the next."""
    same = np.diff(columns["Vehicle_ID"]) == 0.0
    elapsed_ms = np.diff(columns["Global_Time"])
    frames = np.diff(columns["Frame_ID"])
    # Each of NGSIM's periods counts its frames and vehicles anew.
    one_period = same & (np.abs(elapsed_ms) < NAME_USED_AGAIN_MS)
    off_ms = np.where(one_period, elapsed_ms - 1e3 * FRAME_S * frames, 0.0)
    check_numbers(path, {APART: off_ms}, {APART: Numbers(-50.0, 50.0)}, fix="fix the time columns")


def _letters(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())
