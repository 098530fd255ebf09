"""Traffic that is simulated once for several sensors."""

import numpy as np
import pytest

from harness.grid import worker
from harness.grid.worker import RememberedTraffic
from harness.running.open import open_snapshots
from harness.running.resolve import resolve_run_config
from tests.harness.stand_ins import SteadyTraffic


def config(seed: int = 1, range_m: float = 60.0):
    return resolve_run_config(None, {"density": 20.0, "duration": 0.5, "seed": seed}, [f"sensor.range_m={range_m}"])


def made_up(network, traffic, seed, reach_m) -> SteadyTraffic:
    """Return traffic in SUMO's place."""
    return SteadyTraffic(steps=6)


@pytest.fixture
def started(monkeypatch) -> list[int]:
    """Return the seeds of the simulations that were started."""
    seeds: list[int] = []

    def noted(network, traffic, seed, reach_m):
        seeds.append(seed)
        return made_up(network, traffic, seed, reach_m)

    monkeypatch.setattr(worker, "simulate", noted)
    return seeds


def test_two_sensors_look_at_one_simulation_and_see_what_they_would_have_seen_alone(started):
    memory = RememberedTraffic()
    memory(config()).kept()
    again = memory(config(range_m=80.0)).kept()
    alone = open_snapshots(config(range_m=80.0), simulate=made_up).kept()
    assert started == [1]
    for one, other in zip(again, alone, strict=True):
        assert np.array_equal(one.frame.lon_m, other.frame.lon_m)
        assert np.array_equal(one.observation.scan.detections.lon_m, other.observation.scan.detections.lon_m)


def test_other_traffic_is_simulated_anew(started):
    memory = RememberedTraffic()
    for seed in (1, 2, 1):
        memory(config(seed)).kept()
    assert started == [1, 2, 1]


def test_traffic_that_was_not_looked_at_to_its_end_is_not_remembered(started):
    memory = RememberedTraffic()
    snapshots = memory(config())
    next(iter(snapshots))
    snapshots.close()
    memory(config()).kept()
    assert started == [1, 1]
