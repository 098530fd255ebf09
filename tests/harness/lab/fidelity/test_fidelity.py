"""The commands ``fidelity`` and ``calibrate``: what they leave, and what they say to wrong input."""

import json
import os
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from harness.commands.app import run_command_line
from harness.common.numbers import rounded
from harness.lab.fidelity import calibration, comparison
from harness.lab.fidelity.candidate import AMPLITUDE_GAIN
from harness.lab.fidelity.comparison import distances
from harness.lab.fidelity.fields import BIN_S, CELL_M, FIELD_FILES, FOOT_M, Fields
from harness.lab.fidelity.measured import read_measured
from harness.lab.fidelity.samples import UNITS, BehaviourSamples
from harness.lab.fidelity.statistics import PeriodStatistics
from harness.truth.network.network import load_network

FIELDS = Path(os.environ.get("MMPF_REALDATA", "no recordings")) / "us101_fields"
NAMES = ("us101-0750", "us101-0805", "us101-0820")


def wavy_fields(bins, mean=9.0):
    place, time = np.meshgrid(np.arange(104) * CELL_M, np.arange(bins) * BIN_S, indexing="ij")
    speed = mean + 5.5 * np.sin(2.0 * np.pi * (time + place / 5.5) / 130.0)
    density = np.full_like(speed, 0.24)
    return Fields(speed, speed * density, density)


def some_samples(shift=0.0):
    values = {name: np.arange(10.0) + shift for name in UNITS}
    return BehaviourSamples(values, lane_changes=5, vehicle_km=10.0)


@pytest.fixture
def no_sumo(monkeypatch):
    """Put made-up runs in SUMO's place."""

    def made_up(jobs, workers, on_done):
        return [(wavy_fields(round(job.duration_s / BIN_S)), some_samples()) for job in jobs]

    monkeypatch.setattr(comparison, "simulate_all", made_up)
    monkeypatch.setattr(calibration, "simulate_all", made_up)


@pytest.fixture
def recorded_fields(tmp_path):
    """Write made-up fields of 45 minutes as the recorded ones are written."""
    folder = tmp_path / "fields"
    folder.mkdir()
    fields = wavy_fields(540)
    units = {"speed": fields.speed_mps / FOOT_M, "flow": fields.flow_veh_per_s,
             "density": fields.density_veh_per_m * FOOT_M}  # fmt: skip
    for name, file in FIELD_FILES.items():
        np.savetxt(folder / file, units[name])
    return folder


@pytest.mark.slow
def test_the_same_traffic_on_both_sides_meets_every_target(no_sumo, recorded_fields, tmp_path, capsys):
    arguments = ["fidelity", "--fields", str(recorded_fields), "--seeds", "0:1", "--quiet", "--json"]
    assert run_command_line([*arguments, "--out", str(tmp_path / "out")]) == 0
    result = json.loads(capsys.readouterr().out)
    assert set(result["periods"]) == set(NAMES)
    for period in result["periods"].values():
        for side in ("sim", "real"):
            assert {field.name for field in fields(PeriodStatistics)} <= set(period[side])
        assert period["sim"]["density_veh_per_km_lane"] == pytest.approx(48.0)
        assert all(target["met"] for target in period["targets"])
    assert result["distances"] == {}
    assert any("`recordings`" in reason for reason in result["left_out"])
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"fidelity.json", "fidelity.md", "speed_field_us101-0805.png"} <= names


def test_without_recorded_fields_the_committed_figures_are_the_measure(no_sumo, tmp_path, capsys):
    arguments = ["fidelity", "--demand", "us101-0805", "--seeds", "0:2", "--minutes", "5", "--out", str(tmp_path)]
    assert run_command_line([*arguments, "--json"]) == 0
    output = capsys.readouterr()
    result = json.loads(output.out)
    assert result["periods"]["us101-0805"]["real"]["mean_speed_mps"] == pytest.approx(8.576)
    assert len(result["periods"]["us101-0805"]["sim_by_seed"]) == 2
    assert any("`fields`" in reason for reason in result["left_out"])
    assert "within what is allowed" in output.err
    assert "| yes |" in (tmp_path / "fidelity.md").read_text()
    assert not list(tmp_path.glob("speed_field*"))


def test_distances_are_zero_to_itself_and_the_shift_of_what_is_shifted():
    same = distances(some_samples(), some_samples())
    assert set(same) == {*UNITS, "lane_change_rate"}
    assert all(entry["distance"] == 0.0 for entry in same.values())
    shifted = distances(some_samples(0.7), some_samples())
    assert all(shifted[quantity]["distance"] == pytest.approx(0.7) for quantity in UNITS)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["fidelity", "--demand", "rush"], "--demand"),
        (["fidelity", "--demand", "jam"], "--demand"),
        (["fidelity", "--seeds", "5:2"], "--seeds"),
        (["fidelity", "--minutes", "1.5"], "--minutes"),
        (["fidelity", "--fields", "nowhere"], "--fields"),
        (["fidelity", "--recordings", "nowhere"], "--recordings"),
        (["fidelity", "--net", "nowhere"], "--net"),
        (["calibrate", "--demand", "rush"], "--demand"),
        (["calibrate", "--seeds", "x"], "--seeds"),
        (["calibrate", "--fields", "nowhere"], "--fields"),
        (["calibrate", "--minutes", "0"], "--minutes"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(arguments, named, refused):
    assert named in refused(*arguments)


def test_a_network_without_measurements_says_so(tmp_path, refused):
    source = load_network("us101").net_file.parent
    for name in ("us101.net.xml", "vehicles.add.xml"):
        (tmp_path / name).write_bytes((source / name).read_bytes())
    text = (source / "network.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith(("measured_file", "calibration_file"))]
    (tmp_path / "network.toml").write_text("\n".join(lines))
    assert "measured_file" in refused("fidelity", "--net", tmp_path)
    assert "calibration_file" in refused("calibrate", "--net", tmp_path, "--write")


@pytest.fixture
def own_network(tmp_path):
    """Copy the network to a folder of the user's own, which a calibration may write to."""
    source = load_network("us101").net_file.parent
    folder = tmp_path / "net"
    folder.mkdir()
    for file in source.iterdir():
        if file.suffix in (".xml", ".toml"):
            (folder / file.name).write_bytes(file.read_bytes())
    return folder


@pytest.fixture
def calibrated(own_network, tmp_path, capsys):
    """Return what calibrates that network with further options, and hands on the result."""

    def run(*words):
        words = ["calibrate", "--net", str(own_network), "--quiet", "--json", "--out", str(tmp_path / "out"), *words]
        assert run_command_line(words) == 0
        return json.loads(capsys.readouterr().out)

    return run


def test_calibrate_writes_what_the_next_run_reads(no_sumo, own_network, tmp_path, calibrated):
    result = calibrated("--trials", "2", "--seeds", "1000:1001", "--write", "--fresh")
    assert len(result["trials"]) == 2
    network = load_network(str(own_network))
    assert network.drivers.model_dump() == pytest.approx(result["outcome"]["drivers"])
    assert set(network.calibrated) == set(NAMES)
    assert (tmp_path / "out" / "calibration.toml").is_file()


def test_calibrating_one_demand_leaves_drivers_and_other_demands_alone(no_sumo, own_network, calibrated):
    before = load_network(str(own_network))
    calibrated("--demand", "us101-0750", "--trials", "3", "--write", "--fresh")
    after = load_network(str(own_network))
    assert after.demand_files["us101-0805"] == before.demand_files["us101-0805"]
    assert after.demand_files["us101-0750"] != before.demand_files["us101-0750"]
    assert after.drivers == before.drivers


def test_calibrating_all_demands_can_leave_the_drivers_alone(no_sumo, own_network, calibrated):
    before = load_network(str(own_network))
    calibrated("--trials", "2", "--write", "--keep-drivers")
    kept = load_network(str(own_network))
    assert kept.drivers == before.drivers
    assert all(kept.demand_files[name] != before.demand_files[name] for name in NAMES)
    calibrated("--trials", "2", "--write")
    assert load_network(str(own_network)).drivers != before.drivers


def test_every_trial_takes_seeds_of_its_own_and_the_outcome_is_the_mean_of_the_later_candidates(
    calibrated, monkeypatch
):
    seeds = []

    def made_up(jobs, workers, on_done):
        seeds.append([job.seed for job in jobs])
        return [(wavy_fields(180, mean=8.0 + job.seed % 3), some_samples()) for job in jobs]

    monkeypatch.setattr(calibration, "simulate_all", made_up)
    found = calibrated("--demand", "us101-0805", "--trials", "3", "--seeds", "1000:1002")
    assert seeds == [[1000, 1001], [1002, 1003], [1004, 1005]]
    third = found["trials"][2]["demands"]["us101-0805"]["exit_wave_amplitude"]
    outcome = found["outcome"]["demands"]["us101-0805"]["exit_wave_amplitude"]
    measured = read_measured(load_network("us101")).periods["us101-0805"].statistics.share_below_4mps
    slow = found["trials"][2]["simulated"]["us101-0805"]["share_below_4mps"]
    fourth = min(0.9, third + AMPLITUDE_GAIN * 0.9 / 1.6 * (measured - slow))
    assert outcome == pytest.approx((third + fourth) / 2, abs=1e-4)


@pytest.mark.slow
def test_calibrate_runs_end_to_end_on_a_small_budget(calibrated):
    words = ("--demand", "us101-0750", "--trials", "2", "--minutes", "2", "--seeds", "1000:1001")
    trials = calibrated(*words)["trials"]
    assert len(trials) == 2
    assert all(2.0 < trial["simulated"]["us101-0750"]["mean_speed_mps"] < 20.0 for trial in trials)


@pytest.mark.skipif(not FIELDS.is_dir(), reason="no recorded fields; set MMPF_REALDATA")
def test_the_committed_figures_are_those_of_the_recorded_fields(tmp_path):
    from harness.lab.fidelity.fields import read_fields  # noqa: PLC0415
    from harness.lab.fidelity.measured import measure  # noqa: PLC0415

    site = read_measured(load_network("us101"))
    again = measure(site, read_fields(FIELDS), 5)
    assert rounded(again.model_dump(), 4) == rounded(site.model_dump(), 4)
