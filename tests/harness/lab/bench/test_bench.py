from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest

from harness.commands.app import run_command_line
from harness.common.errors import InputError
from harness.lab.bench.bench import BenchPlan, contender_of, run_bench, slopes
from harness.lab.bench.bench_scene import bench_scene
from harness.lab.bench.bench_text import plot
from harness.lab.bench.busy import busy_machine
from harness.lab.bench.measure import SETTLING_STEPS, Contender, Stepping, as_row, time_in_turns
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


def first(setting, options):
    return NamingTracker("first")


def second(setting, options):
    return NamingTracker("second")


@pytest.mark.parametrize("vehicles", [1, 10, 50, 200])
def test_a_scene_has_as_many_vehicles_in_range_as_asked_for(vehicles):
    scene = bench_scene(vehicles, 60, np.random.default_rng(0))
    seen = np.mean([len(scan.detections) for scan in scene.scans])
    expected = 0.95 * vehicles + scene.sensor.clutter_per_scan
    assert seen == pytest.approx(expected, abs=4.0 * np.sqrt((0.05 * vehicles + 1.0) / 60))
    for scan in scene.scans:
        away = np.hypot(scan.detections.lon_m - scan.ego.lon_m, scan.detections.lat_m - scan.ego.lat_m)
        assert (away < scene.sensor.range_m + 10.0).all()


def test_larger_scenes_are_no_denser():
    densities = []
    for vehicles in (50, 200):
        scene = bench_scene(vehicles, 1, np.random.default_rng(0))
        densities.append(vehicles / scene.sensor.range_m)
    assert densities[0] == pytest.approx(densities[1], rel=0.15)


def test_trackers_take_turns_on_every_scan():
    CALLS.clear()
    scene = bench_scene(3, SETTLING_STEPS + 4, np.random.default_rng(0))
    contenders = [Contender(name, f"{__name__}:{name}") for name in ("first", "second")]
    steppings = time_in_turns(contenders, scene, 60.0, lambda: None)
    assert ["first", "second"] * len(scene.scans) == CALLS
    assert all(as_row(stepping, 3)["steps"] == 4 for stepping in steppings)


def test_of_a_slow_tracker_the_last_three_steps_count_if_its_tracks_stood_by_then():
    slow = Stepping(Contender("slow", "slow"), NamingTracker("slow"), steps=9, ms=[float(k) for k in range(9)])
    row = as_row(slow, 3)
    assert (row["steps"], row["ms_p50"], row["cpu_ms_p50"]) == (3, 7.0, None)
    too_slow = Stepping(Contender("slow", "slow"), NamingTracker("slow"), steps=7, ms=[1.0] * 7)
    assert as_row(too_slow, 3)["ms_p50"] is None


def test_a_tracker_whose_time_is_up_drops_out_and_has_no_figures():
    CALLS.clear()
    scene = bench_scene(3, SETTLING_STEPS + 4, np.random.default_rng(0))
    (stepping,) = time_in_turns([Contender("first", f"{__name__}:first")], scene, 1e-9, lambda: None)
    assert len(CALLS) == 1
    assert as_row(stepping, 3)["ms_p50"] is None


def test_the_slope_is_the_power_of_a_power_law_from_25_vehicles_on():
    rows = [
        {"tracker": "a", "model": None, "vehicles": n, "ms_p50": 7.0 if n < 25 else 0.3 * n**1.5, "cpu_ms_p50": 2.0 * n}
        for n in (10, 25, 50, 200)
    ]
    (line,) = slopes(rows)
    assert line["slope"] == pytest.approx(1.5)
    assert line["slope_cpu"] == pytest.approx(1.0)
    assert (line["from"], line["to"]) == (25, 200)


def test_names_stand_for_trackers_with_their_options():
    assert contender_of("mmpf:cvm", 500).options == {"model": "cvm", "particles": 500}
    assert contender_of("stonesoup-gnn:coarse", 500).options == {"coarse_gate": True}
    with pytest.raises(InputError, match="stonesoup-gnn:coarse"):
        contender_of("stonesoup-gnn:fast", 500)


@pytest.mark.parametrize("name", ["oracle-kalman", "mmpf:warp", "nobody"])
def test_what_can_not_be_timed_is_refused(name):
    with pytest.raises(InputError, match=r"`trackers?`"):
        run_bench(BenchPlan(vehicles=(3,), trackers=(name,), particles=20, steps=12), lambda: None)


def test_processes_spin_beside_while_they_are_wanted_and_not_longer():
    with busy_machine(2) as processes:
        assert [process.poll() for process in processes] == [None, None]
    assert all(process.poll() is not None for process in processes)


def test_impossible_numbers_of_vehicles_are_refused(capsys):
    assert run_command_line(["bench", "--vehicles", "10,none"]) == 2
    assert "--vehicles 10,none" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_leaves_rows_with_the_agreed_keys_and_the_filter_follows_every_vehicle_of_the_made_scene(
    tmp_path, capsys
):
    words = ["bench", "--vehicles", "5,30", "--trackers", "mmpf:cvm", "--particles", "50", "--steps", "40", "--json"]
    assert run_command_line([*words, "--out", str(tmp_path / "bench")]) == 0
    result = json.loads(capsys.readouterr().out)
    keys = {"tracker", "model", "vehicles", "particles", "ms_p50", "ms_p95", "peak_mb"}
    assert [row["vehicles"] for row in result["rows"]] == [row["tracks"] for row in result["rows"]] == [5, 30]
    assert all(keys <= set(row) for row in result["rows"])
    assert [(row["components"], row["inputs"]) for row in result["gmm"]] == [(28, 5), (60, 14)]
    assert {"particles", "ms", "matrix_product_ms"} <= set(result["gmm"][0])
    assert (tmp_path / "bench" / "bench.png").is_file()
    assert len(plot(result).axes[0].get_lines()) == 2
