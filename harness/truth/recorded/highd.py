"""highD recordings: three CSV files, metres, 25 frames a second, seen from above with y pointing down.

Positions are the upper left corners of the vehicles' boxes; ``width`` is the extent along the road. Vehicles of driving
direction 1 go towards smaller x on the upper lanes, those of direction 2 towards larger x on the lower ones.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv

from harness.common.errors import InputError
from harness.common.untrusted_files import number
from harness.truth.recorded.rows import ReadTraffic, Rows, unknown
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.road import Lane, Road
from mmpf.numerics.arrays import FloatArray, IntArray

TRACK_COLUMNS = ("frame", "id", "x", "y", "width", "height", "xVelocity", "yVelocity")
META_COLUMNS = ("id", "drivingDirection")
RECORDING_COLUMNS = ("frameRate", "upperLaneMarkings", "lowerLaneMarkings")
UPPER, LOWER = 1, 2
MARKINGS = {UPPER: "upperLaneMarkings", LOWER: "lowerLaneMarkings"}
BEYOND_VIEW_M = 1000.0
LANE_WIDTHS_M = (1.5, 10.0)
LARGEST_ID = 2.0**53


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
        if not file.is_file():
            raise InputError(
                f"{path}: {file.name} is missing; a highD recording has tracks, tracksMeta and recordingMeta"
            )
    return files


def read_highd(path: Path) -> ReadTraffic:
    """Read the carriageway with more vehicles; drop the other one.

    Raises:
        InputError: A file or column is missing, or a value is not a number.
    """
    tracks_file, meta_file, recording_file = recording_files(path)
    meta = _read(meta_file, META_COLUMNS, dict.fromkeys(META_COLUMNS, pa.float64()))
    # Of columns whose kind is not said Arrow takes 0x10 for 16.
    kinds = {"frameRate": pa.float64(), "upperLaneMarkings": pa.string(), "lowerLaneMarkings": pa.string()}
    recording = _read(recording_file, RECORDING_COLUMNS, kinds)
    tracks = _read(tracks_file, TRACK_COLUMNS, dict.fromkeys(TRACK_COLUMNS, pa.float64()))
    identity, direction = (_whole(meta[name].to_numpy(), name, meta_file) for name in META_COLUMNS)
    if not np.isin(direction, (UPPER, LOWER)).all():
        raise InputError(f"{meta_file}: drivingDirection is {UPPER} or {LOWER}; fix or remove the row with another one")
    chosen = LOWER if np.sum(direction == LOWER) >= np.sum(direction == UPPER) else UPPER
    columns = {name: tracks[name].to_numpy() for name in TRACK_COLUMNS}
    rate = float(recording["frameRate"].to_numpy()[0])
    if not 1.0 <= rate <= 1000.0:
        raise InputError(f"{recording_file}: frameRate is {rate:g}; give 1 to 1000 frames a second")
    if not all(np.isfinite(values).all() for values in columns.values()):
        raise InputError(f"{tracks_file}: a value is missing or not finite; fix or remove the row")
    markings = _markings(recording, chosen, recording_file)
    if recording[MARKINGS[UPPER + LOWER - chosen]][0].as_py():
        _markings(recording, UPPER + LOWER - chosen, recording_file)
    on_carriageway = np.isin(columns["id"], identity[direction == chosen])
    without_meta = len(np.setdiff1d(columns["id"], identity))
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
        "without meta data": without_meta,
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
    try:
        markings = np.array([number(word) for word in text.split(";")])
    except ValueError:
        markings = np.zeros(0)
    if len(markings) < 2 or not np.all(np.abs(markings) < BEYOND_VIEW_M):
        raise InputError(f"{path}: {name} is {text!r}; it must be at least two numbers with semicolons between them")
    narrowest_m, widest_m = LANE_WIDTHS_M
    width_m = np.diff(markings)
    if not np.all((width_m >= narrowest_m) & (width_m <= widest_m)):
        raise InputError(
            f"{path}: {name} is {text!r}; from each marking to the next it must be {narrowest_m:g} to {widest_m:g} m"
        )
    return markings


def _whole(values: FloatArray, name: str, path: Path) -> IntArray:
    """Return a column of whole numbers as such."""
    if not (np.abs(values) < LARGEST_ID).all() or (values != np.floor(values)).any():
        raise InputError(f"{path}: {name} has a value that is not a whole number; fix or remove the row")
    return values.astype(np.int64)


def _read(path: Path, columns: tuple[str, ...], types: dict[str, pa.DataType]) -> pa.Table:
    try:
        table = pa.csv.read_csv(path, convert_options=pa.csv.ConvertOptions(column_types=types))
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(f"{path}: broken CSV: {' '.join(str(error).split())[:200]}") from None
    missing = [name for name in columns if name not in table.column_names]
    if missing:
        raise InputError(f"{path}: the column {', '.join(missing)} is missing; highD has {', '.join(columns)}")
    if not len(table):
        raise InputError(f"{path}: it has no rows")
    return table.select(list(columns))
