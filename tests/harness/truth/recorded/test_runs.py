"""Runs on recorded traffic: from the command line's options to a folder that can be replayed."""

import numpy as np
import pandas as pd
import pytest

from harness.common.errors import InputError
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.storage import run_folder as runfolder
from tests.harness.truth.recorded.layouts import write_commonroad, write_highd, write_ngsim_csv

pytestmark = [pytest.mark.usefixtures("read_here"), pytest.mark.slow]

ECHO = "tests.harness.stand_ins:echo_tracker"


@pytest.fixture
def recording(tmp_path):
    return write_ngsim_csv(tmp_path / "scene.csv")


def configured(path, **options):
    return resolve_run_config(options={"replay": str(path), "tracker": ECHO, **options})


@pytest.mark.parametrize(
    ("write", "net"), [(write_ngsim_csv, "us101"), (write_commonroad, "recording"), (write_highd, "recording")]
)
def test_the_configuration_of_a_run_says_all_that_is_needed_to_run_it_again(write, net, tmp_path):
    config = configured(write(tmp_path / "scene"), ego="each", duration=3.5)
    first = run(config, out=tmp_path / "first").folder
    again = run(resolve_run_config(first / runfolder.CONFIG, options={"tracker": ECHO}), out=tmp_path / "again").folder
    assert config.traffic.net == net
    for table in (runfolder.TRUTH, runfolder.DETECTIONS, runfolder.TRACKS):
        assert (first / table).read_bytes() == (again / table).read_bytes()


def test_the_metrics_say_what_became_of_every_vehicle(recording, tmp_path):
    metrics = run(configured(recording, duration=0.5), out=tmp_path / "run").metrics
    told = metrics["recording"]
    assert told["vehicles_read"] == told["vehicles_kept"] + sum(told["vehicles_left_out"].values()) == 4
    assert told["format"] == "ngsim"


def test_a_run_may_begin_in_the_middle_of_a_recording(recording, tmp_path):
    whole = pd.read_parquet(run(configured(recording, duration=3.5), out=tmp_path / "whole").folder / runfolder.TRUTH)
    config = resolve_run_config(
        options={"replay": str(recording), "tracker": ECHO, "duration": 1.5}, settings=["traffic.recording.start_s=2"]
    )
    part = pd.read_parquet(run(config, out=tmp_path / "part").folder / runfolder.TRUTH)
    assert part["step"].max() == 14
    wanted = whole[whole["step"].between(20, 34)]
    for column in ("vehicle_id", "lon_m", "speed_mps", "accel_mps2"):
        np.testing.assert_array_equal(part[column].to_numpy(), wanted[column].to_numpy())


def test_a_run_that_would_begin_after_the_recording_is_refused(recording, tmp_path):
    config = resolve_run_config(
        options={"replay": str(recording), "tracker": ECHO}, settings=["traffic.recording.start_s=99"]
    )
    with pytest.raises(InputError, match="start_s"):
        run(config, out=tmp_path / "run")
