import json
from dataclasses import dataclass

import numpy as np
import pytest

from harness.commands.app import run_command_line
from harness.common.errors import InputError
from harness.lab.bench import SETTLING_STEPS, BenchPlan, TimedTracker, bench_scene, run_bench, time_in_turns
from mmpf.scan import Scan
from mmpf.tracks import Tracks

CALLS: list[str] = []


@dataclass
class NamingTracker:
    """Notes whose turn it was."""

    name: str

    def step(self, scan: Scan) -> Tracks:
        CALLS.append(self.name)
        return Tracks.none()


@pytest.mark.parametrize("vehicles", [1, 10, 50, 200])
def test_a_scene_has_as_many_vehicles_in_range_as_asked_for(vehicles):
    sensor, scans = bench_scene(vehicles, 60, np.random.default_rng(0))
    found = [scan.detections.lon_m - scan.ego.lon_m for scan in scans]
    expected = 0.95 * vehicles + sensor.clutter_per_scan
    assert np.mean(list(map(len, found))) == pytest.approx(expected, abs=4.0 * np.sqrt((0.05 * vehicles + 1.0) / 60))
    assert np.abs(np.concatenate(found)).max() < sensor.range_m + 10.0


def test_trackers_take_turns_on_every_scan_and_the_first_twenty_do_not_count():
    CALLS.clear()
    contenders = [TimedTracker(name, NamingTracker(name)) for name in ("first", "second")]
    _, scans = bench_scene(3, SETTLING_STEPS + 4, np.random.default_rng(0))
    time_in_turns(contenders, scans, 60.0, lambda: None)
    assert ["first", "second"] * (SETTLING_STEPS + 4) == CALLS
    assert all(timed.row(3)["steps"] == 4 for timed in contenders)


def test_of_a_slow_tracker_the_last_three_steps_count_if_its_tracks_stood_by_then():
    slow = TimedTracker("slow", NamingTracker("slow"), ms=[float(k) for k in range(9)], cpu_ms=[1.0] * 9)
    row = slow.row(3)
    assert (row["steps"], row["ms_p50"], row["cpu_ms_p50"]) == (3, 7.0, 1.0)
    assert TimedTracker("slow", NamingTracker("slow"), ms=[1.0] * 7).row(3)["ms_p50"] is None


def test_a_tracker_whose_time_is_up_drops_out_and_has_no_figures():
    CALLS.clear()
    timed = TimedTracker("first", NamingTracker("first"))
    time_in_turns([timed], bench_scene(3, SETTLING_STEPS, np.random.default_rng(0))[1], 1e-9, lambda: None)
    assert len(CALLS) == 1
    assert timed.row(3)["ms_p50"] is None


@pytest.mark.parametrize("name", ["oracle-kalman", "mmpf:warp", "nobody", "stonesoup-gnn:fast"])
def test_what_can_not_be_timed_is_refused(name):
    with pytest.raises(InputError, match=r"`trackers?`"):
        run_bench(BenchPlan(vehicles=(3,), trackers=(name,), particles=20, steps=12), lambda: None)


@pytest.mark.slow
def test_the_command_prints_the_documented_keys_and_the_filter_follows_every_vehicle(tmp_path, capsys):
    words = ["bench", "--vehicles", "5,30", "--trackers", "mmpf:cvm", "--particles", "50", "--steps", "40", "--json"]
    assert run_command_line([*words, "--out", str(tmp_path / "bench")]) == 0
    result = json.loads(capsys.readouterr().out)
    keys = {"tracker", "model", "vehicles", "particles", "ms_p50", "ms_p95"}
    assert [row["vehicles"] for row in result["rows"]] == [row["tracks"] for row in result["rows"]] == [5, 30]
    assert all(keys <= set(row) for row in result["rows"])
