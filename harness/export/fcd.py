"""The truth of a run as SUMO's floating-car data, valid under SUMO's ``fcd_file.xsd``.

SUMO's schema has no place for sizes, so each size is a vehicle type, and a file beside declares the types.
"""

import re
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from harness.running.finished import RecordedRun
from harness.storage.tables import floats, rows_of_steps
from harness.truth.recorded.fcd import types_file

FILE = "fcd.xml"
NOT_IN_XML = re.compile("[^\\t\\n\\r\\x20-\\ud7ff\\ue000-\\ufffd\\U00010000-\\U0010ffff]")


def export(run: RecordedRun, folder: Path) -> list[Path]:
    """Write ``fcd.xml``: position of the front bumper in the plane, angle clockwise from north, speed along the body.

    ``lane`` and ``pos`` are those of the road as one edge, ``road``, so that SUMO's plotting scripts find the vehicles.
    ``fcd.vtypes.xml`` declares the types, one a size; readers need sizes to find a vehicle's centre.
    """
    path = folder / FILE
    path.write_text("\n".join(_lines(run)) + "\n", encoding="utf-8")
    types = types_file(path)
    sizes = np.unique(np.round(run.truth[["length_m", "width_m"]].to_numpy(np.float64), 3), axis=0).tolist()
    each = [f'    <vType id="{_type_name(*size)}" length="{size[0]:.3f}" width="{size[1]:.3f}"/>' for size in sizes]
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<additional>", *each, "</additional>"]
    types.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [path, types]


def _type_name(length_m: float, width_m: float) -> str:
    return f"car_{length_m:.3f}x{width_m:.3f}"


def _lines(run: RecordedRun) -> list[str]:
    truth = run.truth
    columns = ("heading_rad", "speed_mps", "lat_speed_mps", "accel_mps2", "length_m", "width_m")
    in_lane, speed, lat_speed, accel, length, width = (floats(truth, name) for name in columns)
    centre_x, centre_y, heading = run.in_plane(truth)
    pos = floats(truth, "lon_m") + 0.5 * length
    numbers = np.stack(
        [
            centre_x + 0.5 * length * np.cos(heading),
            centre_y + 0.5 * length * np.sin(heading),
            (90.0 - np.degrees(heading)) % 360.0,
            np.maximum(speed / np.cos(in_lane - run.road.axis_of(in_lane)), 0.0),
            # A place on a lane is never negative, one before the road's zero may be.
            pos - min(np.floor(pos.min()), 0.0),
            lat_speed,
            accel,
        ],
        axis=-1,
    )
    pattern = (
        '        <vehicle id=%s x="%.4f" y="%.4f" angle="%.4f" type="%s" speed="%.4f" pos="%.4f" lane="road_%d" '
        'speedLat="%.4f" acceleration="%.4f"/>'
    )
    # SUMO counts lanes from the right, from zero.
    lane = np.maximum(len(run.road.lanes) - truth["lane"].to_numpy(np.int64), 0)
    types = map(_type_name, np.round(length, 3).tolist(), np.round(width, 3).tolist())
    # What XML can not hold is written as %xx.
    names = (quoteattr(NOT_IN_XML.sub(lambda found: f"%{ord(found[0]):02x}", name)) for name in truth["vehicle_id"])
    vehicles = [
        pattern % (name, *row[:3], kind, *row[3:5], number, *row[5:])
        for name, kind, row, number in zip(names, types, numbers.tolist(), lane.tolist(), strict=True)
    ]
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<fcd-export>"]
    times = truth["time_s"].to_numpy(np.float64)
    for rows in rows_of_steps(truth).values():
        lines += [f'    <timestep time="{times[rows.start]:.2f}">', *vehicles[rows], "    </timestep>"]
    return [*lines, "</fcd-export>"]
