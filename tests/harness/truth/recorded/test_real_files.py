"""Real recordings, where they are there: read exactly, nobody left out, and driven from end to end."""

import csv
import os
from pathlib import Path
from xml.dom import minidom

import numpy as np
import pytest

from harness.running.resolve import resolve_run_config
from harness.running.run import run
from tests.harness.truth.recorded.layouts import opened

FOLDER = Path(os.environ.get("MMPF_REALDATA", "no recordings"))
FILES = sorted([*FOLDER.glob("commonroad/*.xml"), *FOLDER.glob("ngsim/*.csv")])
SAMPLES = 20
FOOT_M = 0.3048
LEFT_EDGE_M = 5 * 3.66

pytestmark = pytest.mark.skipif(not FILES, reason="no real recordings; set MMPF_REALDATA")


def positions_in_commonroad(path: Path) -> dict[tuple[str, int], tuple[float, float]]:
    """Read centre positions by vehicle and time step with another XML library."""
    found = {}
    document = minidom.parse(str(path))
    for tag in ("obstacle", "dynamicObstacle"):
        for obstacle in document.getElementsByTagName(tag):
            for state in [*obstacle.getElementsByTagName("initialState"), *obstacle.getElementsByTagName("state")]:
                x, y, time = (
                    float(_inside(state, *names)) for names in (("point", "x"), ("point", "y"), ("time", "exact"))
                )
                found[obstacle.getAttribute("id"), int(time)] = (x, y)
    return found


def _inside(element: minidom.Element, *names: str) -> str:
    for name in names:
        element = element.getElementsByTagName(name)[0]
    return element.firstChild.nodeValue


def positions_in_ngsim(path: Path) -> dict[tuple[str, int], tuple[float, float]]:
    """Read centre positions beside the road by vehicle and time step with another CSV library."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    first = min(int(row["Global_Time"]) for row in rows)
    return {
        (row["Vehicle_ID"], (int(row["Global_Time"]) - first) // 100): (
            FOOT_M * (float(row["Local_Y"]) - 0.5 * float(row["v_Length"])),
            LEFT_EDGE_M - FOOT_M * float(row["Local_X"]),
        )
        for row in rows
    }


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_positions_are_those_of_an_independent_read(path):
    truth = opened(path)
    traffic = truth.traffic
    if path.suffix == ".xml":
        wanted = positions_in_commonroad(path)
        found_x, found_y = truth.road.to_cartesian(traffic.columns["lon_m"], traffic.columns["lat_m"])
    else:
        wanted = positions_in_ngsim(path)
        found_x, found_y = traffic.columns["lon_m"], traffic.columns["lat_m"]
    steps = traffic.step_of_row
    assert len(steps) == len(wanted)
    for row in np.random.default_rng(len(wanted)).choice(len(steps), SAMPLES, replace=False):
        x, y = wanted[str(traffic.names[traffic.stay[row]]), int(steps[row])]
        assert np.hypot(found_x[row] - x, found_y[row] - y) < 1e-9


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_nobody_is_left_out_and_everybody_is_on_the_road(path):
    truth = opened(path)
    counts = truth.traffic.counts
    assert counts.vehicles_kept == counts.vehicles_read > 10
    assert not counts.left_out
    # NGSIM's ramps are no lanes of the main road.
    assert np.mean(truth.traffic.lane == 0) < 0.02


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_stated_speeds_are_those_of_the_positions(path):
    """The mean speed over each vehicle's stay, from its first and last position, against the speeds it was given."""
    traffic = opened(path).traffic
    for stay in np.unique(traffic.stay):
        rows = np.flatnonzero(traffic.stay == stay)
        if len(rows) < 30:
            continue
        travelled = traffic.columns["lon_m"][rows[-1]] - traffic.columns["lon_m"][rows[0]]
        stated = np.trapezoid(traffic.columns["speed_mps"][rows], dx=0.1)
        assert travelled == pytest.approx(stated, abs=2.5)


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_recording_is_driven_tracked_and_scored(path, tmp_path):
    config = resolve_run_config(options={"replay": str(path), "model": "gmm", "particles": 100, "duration": 10.0})
    metrics = run(config, out=tmp_path / "run").metrics
    told = metrics["recording"]
    assert told["vehicles_kept"] + sum(told["vehicles_left_out"].values()) == told["vehicles_read"]
    assert metrics["mot"]["hota"] > 85.0
    assert metrics["mae"]["visible"]["lon_m"] < 0.4
