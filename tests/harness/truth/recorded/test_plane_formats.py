"""Formats whose vehicles drive in the plane: PandaSet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.truth.recorded.formats import example, read_traffic, recognise
from harness.truth.recorded.source import open_recorded_traffic

STEPS = 51
HEADER = "timestamp,uuid,label,yaw,position.x,position.y,dimensions.x,dimensions.y"


def write_pandaset(path: Path, turn: float = -0.5 * np.pi) -> Path:
    """Write a recording car that stands, a car that drives along x at 10 m/s, and a pedestrian."""
    rows = [HEADER]
    for k in range(STEPS):
        rows.append(f"{0.1 * k:.1f},ego,Ego,{turn},0,0,1.9,5.2")
        rows.append(f"{0.1 * k:.1f},a,Car,{turn},{10 + k},3.5,1.8,4.5")
        rows.append(f"{0.1 * k:.1f},p,Pedestrian,0,5,9,0.5,0.5")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_pandasets_vehicles_drive_where_their_cuboids_are(tmp_path):
    path = write_pandaset(tmp_path / "scene.dat")
    assert recognise(path).name == "pandaset"
    truth = open_recorded_traffic(path, "pandaset", "recording", "ego", 60.0)
    frames = list(truth.frames())
    assert len(frames) == STEPS
    for k, frame in enumerate(frames):
        row = frame.vehicle_id.tolist().index("a")
        assert frame.lon_m[row] - frame.lon_m[frame.ego] == pytest.approx(10.0 + k)
        assert frame.lat_m[row] - frame.lat_m[frame.ego] == pytest.approx(3.5)
        assert frame.heading_rad[row] == pytest.approx(0.0, abs=1e-9)
        assert frame.speed_mps[row] == pytest.approx(10.0)
        assert (frame.length_m[row], frame.width_m[row]) == (4.5, 1.8)
    assert truth.summary()["vehicles_left_out"] == {"no vehicle": 1}


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda text: text.replace("position.y", "y"), "position.y is missing"),
        (lambda text: text.replace(",3.5,", ",far,", 1), "no table of PandaSet's cuboids"),
        (lambda text: text.replace(",3.5,", ",inf,", 1), "not finite"),
        (lambda text: text.replace(",3.5,", ",1e12,", 1), "farther than"),
        (lambda text: text.replace(",Car,", ",Cones,").replace(",Ego,", ",Cones,"), "no vehicle"),
        (lambda text: text.replace(",a,", ",,"), "no name"),
    ],
)
def test_what_is_wrong_with_a_table_of_cuboids_is_one_line(spoil, said, tmp_path):
    path = write_pandaset(tmp_path / "scene.csv")
    path.write_text(spoil(path.read_text()))
    with pytest.raises(InputError, match=said) as error:
        read_traffic(path, "pandaset", "recording")
    assert "\n" not in str(error.value)


def test_the_sequence_that_comes_with_the_harness_runs_by_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = resolve_run_config(options={"replay": "pandaset", "tracker": "oracle-kalman", "duration": 2.0})
    assert config.traffic.recording.ego == "ego"
    metrics = run(config, out=tmp_path / "run").metrics
    assert metrics["recording"]["vehicles_kept"] > 50
    assert metrics["recording"]["seconds"] == 2.0


def test_a_file_goes_before_an_example_of_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_pandaset(Path("pandaset"))
    assert example(Path("pandaset")) == Path("pandaset")


def test_the_sequence_that_comes_with_the_harness_names_its_licence():
    notice = example(Path("pandaset")).with_name("NOTICE").read_text()
    assert "CC BY 4.0" in notice
