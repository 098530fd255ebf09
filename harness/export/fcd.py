"""The truth of a run as SUMO's floating-car data: what ``sumo --fcd-output`` writes, with the vehicles' sizes."""

from __future__ import annotations

import re
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from harness.report.finished import RecordedRun
from harness.runfolder.tables import floats

FILE = "fcd.xml"
NOT_IN_XML = re.compile("[^\\t\\n\\r\\x20-\\ud7ff\\ue000-\\ufffd\\U00010000-\\U0010ffff]")


def export(run: RecordedRun, folder: Path) -> list[Path]:
    """Write ``fcd.xml``: position of the front bumper in the plane, angle clockwise from north, speed along the body.

    ``lane`` and ``pos`` are those of the road as one edge, ``road``, so that SUMO's plotting scripts find the vehicles.
    ``length`` and ``width`` stand beside SUMO's own attributes, since readers need them to find a vehicle's centre.
    """
    path = folder / FILE
    path.write_text("\n".join(_lines(run)) + "\n", encoding="utf-8")
    return [path]


def _in_xml(name: str) -> str:
    """Return a name with the characters that XML can not hold written as %xx."""
    return NOT_IN_XML.sub(lambda found: f"%{ord(found[0]):02x}", name)


def _lines(run: RecordedRun) -> list[str]:
    truth = run.truth
    columns = ("heading_rad", "speed_mps", "lat_speed_mps", "accel_mps2", "length_m", "width_m")
    in_lane, speed, lat_speed, accel, length, width = (floats(truth, name) for name in columns)
    centre_x, centre_y, heading = run.in_plane(truth)
    numbers = np.stack(
        [
            centre_x + 0.5 * length * np.cos(heading),
            centre_y + 0.5 * length * np.sin(heading),
            (90.0 - np.degrees(heading)) % 360.0,
            np.maximum(speed / np.cos(in_lane), 0.0),
            floats(truth, "lon_m") + 0.5 * length,
            lat_speed,
            accel,
            length,
            width,
        ],
        axis=-1,
    )
    pattern = (
        '        <vehicle id=%s x="%.4f" y="%.4f" angle="%.4f" type="car" speed="%.4f" pos="%.4f" lane="road_%d" '
        'speedLat="%.4f" acceleration="%.4f" length="%.3f" width="%.3f"/>'
    )
    # SUMO counts lanes from the right, from zero.
    lane = np.maximum(len(run.road.lanes) - truth["lane"].to_numpy(np.int64), 0)
    vehicles = [
        pattern % (quoteattr(_in_xml(name)), *row[:4], row[4], number, *row[5:])
        for name, row, number in zip(truth["vehicle_id"], numbers.tolist(), lane.tolist(), strict=True)
    ]
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<fcd-export>"]
    times = truth["time_s"].to_numpy(np.float64)
    first = np.unique(truth["step"].to_numpy(), return_index=True)[1]
    for begin, end in zip(first, np.append(first[1:], len(truth)), strict=True):
        lines += [f'    <timestep time="{times[begin]:.2f}">', *vehicles[begin:end], "    </timestep>"]
    return [*lines, "</fcd-export>"]
