"""A whole morning of NGSIM, duplicates and all, is read in a minute and little memory."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest

from tests.harness.truth.recorded.layouts import EPOCH_MS, NGSIM_HEADER, TEXT_COLUMN_COUNT

ROWS, DUPLICATES, VEHICLES = 4_800_000, 704_000, 6_100
LIMIT_S, LIMIT_GB = 60.0, 4.0

READ = """
import pathlib, resource, sys, time
from harness.truth.recorded.source import open_recorded_traffic
begin = time.perf_counter()
truth = open_recorded_traffic(pathlib.Path(sys.argv[1]), sys.argv[2], "us101", "auto", 2700.0)
assert len(next(iter(truth.frames()))) >= 1
print(time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)
counts = truth.traffic.counts
print(counts.rows_kept + counts.duplicates, counts.duplicates, counts.vehicles_kept)
"""


def morning(rows: int, duplicates: int, vehicles: int) -> pa.Table:
    """Return the public CSV's columns: vehicles that pass the section, a speed for each lane, then copies of some rows.

    Those of a lane enter two seconds apart, so that no two are ever in one place.
    """
    rng = np.random.default_rng(6)
    frames = np.full(vehicles, (rows - duplicates) // vehicles)
    frames[: (rows - duplicates) % vehicles] += 1
    vehicle = np.repeat(np.arange(vehicles), frames)
    age = np.arange(len(vehicle)) - np.repeat(np.cumsum(frames) - frames, frames)
    frame = age + (26_000 * vehicle) // vehicles
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
@pytest.mark.parametrize(("layout", "part"), [("ngsim", 1), ("ngsim-text", 2)])
def test_forty_five_minutes_of_ngsim_are_read_within_a_minute_and_four_gigabytes(layout, part, tmp_path):
    """Of the older layout a half is read."""
    path, numbers = tmp_path / "morning", [number // part for number in (ROWS, DUPLICATES, VEHICLES)]
    table = morning(*numbers)
    if layout == "ngsim":
        pa.csv.write_csv(table.append_column("Location", pa.array(["us-101"] * ROWS)), path)
    else:
        pa.csv.write_csv(table, path, pa.csv.WriteOptions(include_header=False, delimiter=" "))
    words = [sys.executable, "-c", READ, str(path), layout]
    told = subprocess.run(words, capture_output=True, check=True, cwd=Path(__file__).parents[4]).stdout.split()
    taken_s, used_gb, *counted = map(float, told)
    assert counted == numbers
    assert taken_s < LIMIT_S / part
    assert used_gb < LIMIT_GB / part**0.5
