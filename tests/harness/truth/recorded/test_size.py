"""A quarter of an hour of NGSIM, duplicates and all, is read in little memory."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest

from tests.harness.truth.recorded.layouts import EPOCH_MS, NGSIM_HEADER, TEXT_COLUMN_COUNT

ROWS, DUPLICATES, VEHICLES = 1_600_000, 234_000, 2_030
LIMIT_GB = 2.0

READ = """
import resource, sys
from pathlib import Path
from harness.truth.recorded.source import open_recorded_traffic
truth = open_recorded_traffic(Path(sys.argv[1]), sys.argv[2], "us101", "auto", 900.0)
first = next(iter(truth.frames()))
counts = truth.traffic.counts
print(len(first), counts.rows_kept + counts.duplicates, counts.duplicates, counts.vehicles_kept)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)
"""


def quarter_of_an_hour(rows: int, duplicates: int, vehicles: int) -> pa.Table:
    """Return the public CSV's columns: vehicles that pass the section, a speed for each lane, then copies of some rows.

    Those of a lane enter two seconds apart, so that no two are ever in one place.
    """
    rng = np.random.default_rng(6)
    frames = np.full(vehicles, (rows - duplicates) // vehicles)
    frames[: (rows - duplicates) % vehicles] += 1
    vehicle = np.repeat(np.arange(vehicles), frames)
    age = np.arange(len(vehicle)) - np.repeat(np.cumsum(frames) - frames, frames)
    frame = age + (8_000 * vehicle) // vehicles
    lane = vehicle % 5
    speed_ftps = rng.uniform(28.0, 34.0, 5)[lane]
    columns = {name: np.zeros(len(vehicle)) for name in NGSIM_HEADER.split(",")[:TEXT_COLUMN_COUNT]}
    columns |= {
        "Vehicle_ID": vehicle + 1,
        "Frame_ID": frame,
        "Total_Frames": frames[vehicle],
        "Global_Time": EPOCH_MS + 100 * frame,
        "Local_X": 12.0 * lane + 6.0,
        "Local_Y": np.round(30.0 + 0.1 * speed_ftps * age, 3),
        "v_Length": np.full(len(vehicle), 14.5),
        "v_Width": np.full(len(vehicle), 6.2),
        "v_Vel": np.round(speed_ftps, 2),
    }
    copies = rng.choice(len(vehicle), duplicates, replace=False)
    return pa.table({name: np.concatenate([values, values[copies]]) for name, values in columns.items()})


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["ngsim", "ngsim-text"])
def test_a_quarter_of_an_hour_of_ngsim_is_read_within_two_gigabytes(layout, tmp_path):
    path, table = tmp_path / "recording", quarter_of_an_hour(ROWS, DUPLICATES, VEHICLES)
    if layout == "ngsim":
        pa.csv.write_csv(table.append_column("Location", pa.array(["us-101"] * ROWS)), path)
    else:
        pa.csv.write_csv(table, path, pa.csv.WriteOptions(include_header=False, delimiter=" "))
    words = [sys.executable, "-c", READ, str(path), layout]
    told = subprocess.run(words, capture_output=True, check=True, cwd=Path(__file__).parents[4]).stdout.split()
    first, *counted = map(int, told[:-1])
    assert first >= 1
    assert counted == [ROWS, DUPLICATES, VEHICLES]
    assert float(told[-1]) < LIMIT_GB
