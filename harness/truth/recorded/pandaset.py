"""PandaSet's cuboids of one sequence as CSV, with PandaSet's column names and a ``timestamp`` before them.

Its boxes' ``yaw`` is the direction of their x axis, along the width; the front is a quarter turn to the left of it.
An excerpt comes with the project, see ``examples/NOTICE``.
"""

from pathlib import Path
from typing import BinaryIO

import numpy as np
import pandas as pd

from harness.common.bounds import check_columns
from harness.truth.recorded.planetracks import PlaneTrajectory, Scene, traffic_of_scene
from harness.truth.recorded.rows import ReadTraffic, unknown
from mmpf.scan import BUS, CAR, MOTORCYCLE, TRUCK, UNKNOWN_CLASS

NUMBERS = ("timestamp", "yaw", "position.x", "position.y", "dimensions.x", "dimensions.y")
COLUMNS = (*NUMBERS, "uuid", "label")
VEHICLES = {"Car": CAR, "Ego": CAR, "Bus": BUS, "Motorcycle": MOTORCYCLE, "Other Vehicle - Construction Vehicle": TRUCK}
VEHICLES |= dict.fromkeys(("Pickup Truck", "Medium-sized Truck", "Semi-truck"), TRUCK)
VEHICLES |= dict.fromkeys(("Other Vehicle - Uncommon", "Emergency Vehicle"), UNKNOWN_CLASS)


def read_pandaset(path: Path) -> ReadTraffic:
    """Read a sequence, in the plane without a map."""
    return traffic_of_scene(path, _scene, "table of PandaSet's cuboids")


def _scene(file: BinaryIO) -> Scene:
    table = pd.read_csv(file, dtype=str, keep_default_na=False)
    check_columns("a table", table.columns, COLUMNS)
    table = table.assign(**{name: pd.to_numeric(table[name]) for name in NUMBERS})
    vehicles = table[table["label"].isin(VEHICLES)]
    ways = [
        PlaneTrajectory(
            name=str(name),
            time_s=rows["timestamp"].to_numpy(),
            x_m=rows["position.x"].to_numpy(),
            y_m=rows["position.y"].to_numpy(),
            heading_rad=rows["yaw"].to_numpy() + 0.5 * np.pi,
            speed_mps=unknown(len(rows)),
            length_m=rows["dimensions.y"].to_numpy(),
            width_m=rows["dimensions.x"].to_numpy(),
            vehicle_class=VEHICLES[str(rows["label"].iloc[0])],
        )
        for name, rows in vehicles.groupby("uuid", sort=True)
    ]
    return ways, {}, table["uuid"].nunique() - len(ways)
