from dataclasses import replace

import numpy as np
import pandas as pd

from harness.running.follow import StageTimes
from harness.running.metrics import timing_table
from harness.running.watchers import DiagnosticsKeeper
from harness.sensor.observation import Snapshot
from harness.trackers.protocol import TrackerSetting
from mmpf.scan import SensorModel
from mmpf.stages.reporting import StepReport
from mmpf.tracks import Tracks
from tests.harness.stand_ins import EchoTracker, SteadyTraffic


class TellingTracker(EchoTracker):
    """Tells of as many births as it has made steps."""

    last_report = StepReport()


def kept(tracker: EchoTracker, reports: list[StepReport]) -> DiagnosticsKeeper:
    keeper = DiagnosticsKeeper()
    for frame, report in zip(SteadyTraffic(steps=len(reports)).frames(), reports, strict=True):
        if isinstance(tracker, TellingTracker):
            tracker.last_report = report
        keeper.watch(Snapshot(frame, None), Tracks.none(), tracker)
    return keeper


def setting() -> TrackerSetting:
    return TrackerSetting(SteadyTraffic().road, SensorModel(), np.random.default_rng(0))


def test_each_step_leaves_one_row_without_wall_times():
    reports = [StepReport(components=3 + k, births=k, stage_ms={"prior update": 1.0 + k}) for k in range(4)]
    table = kept(TellingTracker(setting()), reports).table()
    assert table is not None
    assert table["step"].tolist() == [0, 1, 2, 3]
    assert table["components"].tolist() == [3, 4, 5, 6]
    assert table["births"].tolist() == [0, 1, 2, 3]
    assert not [column for column in table if "ms" in column or "stage" in column]
    slower = [replace(report, stage_ms={"prior update": 50.0}) for report in reports]
    pd.testing.assert_frame_equal(table, kept(TellingTracker(setting()), slower).table())


def test_a_tracker_that_tells_nothing_leaves_no_table():
    assert kept(EchoTracker(setting()), [StepReport()] * 3).table() is None


def test_stages_have_percentiles_under_keys_without_blanks():
    keeper = kept(
        TellingTracker(setting()), [StepReport(stage_ms={"remove, add, merge": float(k)}) for k in range(101)]
    )
    stages = timing_table(StageTimes(), 0.1, 1.0, keeper.stages_ms)["stages"]
    assert stages == {"remove_add_merge": {"p50": 50.0, "p95": 95.0, "p99": 99.0}}
