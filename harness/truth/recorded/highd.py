"""highD recordings: three CSV files, metres, 25 frames a second, seen from above with y pointing down.

Positions are the upper left corners of the vehicles' boxes; ``width`` is the extent along the road. Vehicles of driving
direction 1 go towards smaller x on the upper lanes, those of direction 2 towards larger x on the lower ones.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv

from harness.common.bounds import Numbers, check_columns, check_numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import number, reading, require_file
from harness.truth.recorded.rows import ReadTraffic, Rows, unknown
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.road import Lane, Road
from mmpf.numerics.arrays import FloatArray

UPPER, LOWER = 1, 2
MARKINGS = {UPPER: "upperLaneMarkings", LOWER: "lowerLaneMarkings"}
BEYOND_VIEW_M = 1000.0
IDENTITY = Numbers(-(2.0**53), 2.0**53, whole=True)
TRACKS = dict.fromkeys(("frame", "id", "x", "y", "width", "height", "xVelocity", "yVelocity"), Numbers())
META = {"id": IDENTITY, "drivingDirection": Numbers(UPPER, LOWER, whole=True)}
RECORDING = {"frameRate": Numbers(1.0, 1000.0)}
"""The columns that are read, and what their numbers may be."""
MARKING_M, LANE_WIDTH_M = Numbers(-BEYOND_VIEW_M, BEYOND_VIEW_M), Numbers(1.5, 10.0)


def recording_files(path: Path) -> tuple[Path, Path, Path]:
    """Return the files of tracks, tracks' meta data and recording's meta data, given the folder or the tracks' file.

    Raises:
        InputError: One is missing, or the folder holds several recordings.
    """
    tracks = path
    if path.is_dir():
        found = sorted(path.glob("*_tracks.csv"))
        if len(found) != 1:
            raise InputError(f"{path}: {len(found)} highD recordings in the folder; name one of them: NN_tracks.csv")
        tracks = found[0]
    stem = tracks.name.removesuffix("_tracks.csv")
    files = (tracks, tracks.with_name(f"{stem}_tracksMeta.csv"), tracks.with_name(f"{stem}_recordingMeta.csv"))
    for file in files:
        require_file(file, f"{path}: of highD's tracks, tracksMeta and recordingMeta")
    return files


def read_highd(path: Path) -> ReadTraffic:
    """Read the carriageway with more vehicles; drop the other one.

    Raises:
        InputError: A file or column is missing, or a value is not a number.
    """
    tracks_file, meta_file, recording_file = recording_files(path)
    meta = _read(meta_file, META)
    recording = _read(recording_file, RECORDING, tuple(MARKINGS.values()))
    tracks = _read(tracks_file, TRACKS)
    identity, direction = (meta[name].to_numpy().astype(np.int64) for name in META)
    chosen = LOWER if np.sum(direction == LOWER) >= np.sum(direction == UPPER) else UPPER
    columns = {name: tracks[name].to_numpy() for name in TRACKS}
    rate = float(recording["frameRate"].to_numpy()[0])
    markings = _markings(recording, chosen, recording_file)
    if recording[MARKINGS[UPPER + LOWER - chosen]][0].as_py():
        _markings(recording, UPPER + LOWER - chosen, recording_file)
    on_carriageway = np.isin(columns["id"], identity[direction == chosen])
    names, vehicle = np.unique(columns["id"][on_carriageway].astype(np.int64), return_inverse=True)
    road, rows = _in_road_frame(
        {name: values[on_carriageway] for name, values in columns.items()},
        vehicle.astype(np.int64),
        markings,
        chosen,
        rate,
    )
    left_out = {
        "on the other carriageway": int(np.sum(direction != chosen)),
        "without meta data": len(np.setdiff1d(columns["id"], identity)),
        "without rows": len(np.setdiff1d(identity[direction == chosen], columns["id"])),
    }
    return ReadTraffic(road, names.astype(np.str_), rows, len(names) + sum(left_out.values()), left_out)


def _in_road_frame(
    columns: dict[str, FloatArray],
    vehicle: np.ndarray[tuple[int], np.dtype[np.int64]],
    markings: FloatArray,
    direction: int,
    rate: float,
) -> tuple[Road, Rows]:
    """Turn the picture's frame into the road's: to the left of the driving direction is up for x, down against it."""
    sign = 1.0 if direction == LOWER else -1.0
    right_edge = markings.max() if direction == LOWER else markings.min()
    x = columns["x"] + 0.5 * columns["width"]
    y = columns["y"] + 0.5 * columns["height"]
    lines_m = np.sort(sign * (right_edge - markings))
    lanes = tuple(
        Lane(len(lines_m) - 1 - k, float(lines_m[k]), float(lines_m[k + 1]), -BEYOND_VIEW_M, BEYOND_VIEW_M + 1e4)
        for k in range(len(lines_m) - 1)
    )
    # The Cartesian plane is the picture with y turned upwards, so that the frame stays right-handed.
    origin_x = 0.0 if direction == LOWER else float(columns["x"].max() + columns["width"].max())
    reference = ((origin_x, -float(right_edge)), (origin_x + sign * 1000.0, -float(right_edge)))
    road = CorridorRoad(lanes=lanes, reference_xy=reference)
    rows = Rows(
        vehicle=vehicle,
        time_s=columns["frame"] / rate,
        lon_m=sign * (x - origin_x),
        lat_m=sign * (right_edge - y),
        heading_rad=unknown(len(x)),
        speed_mps=sign * columns["xVelocity"],
        lat_speed_mps=-sign * columns["yVelocity"],
        length_m=columns["width"],
        width_m=columns["height"],
    )
    return road, rows


def _markings(recording: pa.Table, direction: int, path: Path) -> FloatArray:
    name = MARKINGS[direction]
    text = str(recording[name][0].as_py() or "")
    with reading(path, f"two or more numbers with semicolons between them, {name} is {text!r}"):
        first, *others = (number(word) for word in text.split(";"))
        markings = np.array([first, others[0], *others[1:]])
        MARKING_M.check("a marking", markings)
        LANE_WIDTH_M.check("the width between two markings", np.diff(markings))
    return markings


def _read(path: Path, numbers: Mapping[str, Numbers], texts: tuple[str, ...] = ()) -> pa.Table:
    """Return columns of numbers and of texts; of those whose kind is not said Arrow would take 0x10 for 16."""
    types = dict.fromkeys(numbers, pa.float64()) | dict.fromkeys(texts, pa.string())
    with reading(path, "CSV of numbers"):
        table = pa.csv.read_csv(path, convert_options=pa.csv.ConvertOptions(column_types=types))
    check_columns(path, table.column_names, types)
    if not len(table):
        raise InputError(f"{path}: it has no rows")
    check_numbers(path, {name: table[name].to_numpy() for name in numbers}, numbers)
    return table.select(list(types))
