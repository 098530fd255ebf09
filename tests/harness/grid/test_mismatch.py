import numpy as np
import pandas as pd
import pytest

from harness.grid.grid import GridRequest, plan_grid
from harness.grid.mismatch import AS_IS, costs, costs_markdown, mismatches
from harness.sensor.profiles import sensor_settings


def test_every_tracker_runs_under_every_mismatch_on_shared_detections():
    grid = plan_grid(GridRequest(densities="20", seeds="2", trackers="mmpf,stonesoup-jpda", mismatch=True))
    assert len(grid.cells) == 2 * 7
    assert len({run.key for run in grid.runs}) == 2 * 7 * 2
    for cell in grid.cells:
        assert len({run.mismatch for run in cell.runs}) == 1
        assert cell.runs[0].config.sensor == cell.runs[1].config.sensor
        assert cell.runs[0].config.tracker.believes == cell.runs[1].config.tracker.believes


def test_five_times_the_clutter_is_five_times_that_of_the_profile():
    sensor = sensor_settings("lidar", {})
    words = dict(word.split("=") for word in mismatches(sensor)["clutter x 5"])
    assert float(words["sensor.clutter_per_scan"]) == pytest.approx(5 * sensor.clutter_per_scan)
    assert float(words["sensor.persistent_clutter"]) == pytest.approx(5 * sensor.persistent_clutter)


def test_losses_are_paired_run_by_run():
    rows = [
        {"variant": "a", "model": None, "density": 20.0, "demand": None, "seed": seed, "mismatch": mismatch}
        | {"mot.hota": hota, "mot.id_switches": 3.0, "calibration.coverage95.lon": 95.0, "succeeded": True}
        for mismatch, values in ((AS_IS, (90.0, 60.0, 80.0)), ("bursts", (88.0, 57.0, 76.0)))
        for seed, hota in enumerate(values)
    ]
    usual, bursts = costs(pd.DataFrame(rows))
    assert usual.hota_loss == 0.0
    assert bursts.hota_loss == pytest.approx(np.mean([2.0, 3.0, 4.0]))
    low, high = bursts.hota_loss_ci95
    # Three runs with a standard deviation of 1: 4.303 standard errors of 1 / sqrt(3) to either side.
    assert (low, high) == pytest.approx((3.0 - 4.303 / 3**0.5, 3.0 + 4.303 / 3**0.5), abs=1e-3)
    assert "| a | bursts | 73.7 | 3.0 [" in costs_markdown([usual, bursts], [])
