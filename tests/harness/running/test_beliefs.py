"""What trackers are told of the sensor, apart from what is true."""

from dataclasses import replace

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.running.open import as_believed
from harness.running.resolve import resolve_run_config
from mmpf.scan import SensorModel
from tests.harness.stand_ins import EchoTracker, SteadyTraffic, observing, track


def told(*settings, signals=""):
    """Return the data sheets and scans that a tracker is given under these settings, with signals in every frame."""
    sheets, scans = [], []

    class Listener(EchoTracker):
        def step(self, scan):
            scans.append(scan)
            return super().step(scan)

    def build(setting):
        sheets.append(setting.sensor)
        return Listener(setting)

    config = resolve_run_config(settings=["sensor.profile=lidar", *settings])
    snapshots = observing(SteadyTraffic(steps=5))(config).kept()
    shown = [replace(snapshot, frame=replace(snapshot.frame, signals=signals)) for snapshot in snapshots]
    tables = track(as_believed(replace(snapshots, stream=shown), config), build, 0)
    return sheets[0], scans, tables


def test_a_tracker_is_told_the_data_sheet_whatever_is_true_and_what_it_shall_believe_instead():
    usual, _, _ = told()
    harder, _, _ = told("sensor.detection_probability=0.5", "sensor.clutter_per_scan=9")
    assert harder == usual
    believing, _, _ = told("tracker.believes.detection_probability=0.6", "tracker.believes.clutter_per_scan=2.5")
    assert (believing.detection_probability, believing.clutter_per_scan) == (0.6, 2.5)
    assert believing.range_m == usual.range_m


def test_the_noise_factor_multiplies_every_reported_deviation_and_nothing_that_is_recorded():
    _, usual, recorded = told()
    _, halved, recorded_again = told("tracker.believes.noise_factor=0.5")
    for one, other in zip(usual, halved, strict=True):
        first, second = one.detections, other.detections
        assert second.lon_m.tobytes() == first.lon_m.tobytes()
        for name in ("std_lon_m", "std_lat_m"):
            assert getattr(second, name) == pytest.approx(0.5 * getattr(first, name))
        assert second.sizes.std_length_m == pytest.approx(0.5 * first.sizes.std_length_m)
    assert recorded.detections.equals(recorded_again.detections)


def test_beliefs_outlive_the_choice_of_another_tracker_and_contradictions_are_refused():
    config = resolve_run_config(
        options={"tracker": "stonesoup-gnn"}, settings=["tracker.believes.noise_factor=2", "tracker.name=oracle-kalman"]
    )
    assert config.tracker.believes.noise_factor == 2.0
    with pytest.raises(InputError, match=r"tracker\.believes.*hidden_fraction"):
        told("tracker.believes.hidden_fraction=0.9")
    with pytest.raises(InputError, match="noise_facto"):
        resolve_run_config(settings=["tracker.believes.noise_facto=2"])


@pytest.mark.parametrize(
    "values",
    [
        {"range_m": 0.0},
        {"range_m": np.inf},
        {"clutter_area_m2": -1.0},
        {"detection_probability": 1.1},
        {"hidden_fraction": 0.7},
        {"clutter_per_scan": np.nan},
        {"noise_correlated_share": 2.0},
    ],
)
def test_an_impossible_data_sheet_is_refused_by_name(values):
    with pytest.raises(ValueError, match=next(iter(values))) as refusal:
        SensorModel(**values)
    assert "\n" not in str(refusal.value)


def test_no_tracker_is_told_of_signals_unless_it_shall_know_them():
    assert all(scan.open_signals is None for scan in told(signals="10")[1])
    scans = told("tracker.knows_signals=true", signals="10")[1]
    assert scans[-1].open_signals.tolist() == [True, False]
