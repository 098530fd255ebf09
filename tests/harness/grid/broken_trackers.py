"""Trackers that fail in the ways that a grid must outlive."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping

from harness.trackers.protocol import TrackerSetting
from mmpf.scan import Scan
from mmpf.tracks import Tracks
from tests.harness.stand_ins import EchoTracker


class RaisingTracker(EchoTracker):
    def step(self, scan: Scan) -> Tracks:
        if scan.time_s > 0.5:
            raise ArithmeticError("the weights\nall vanished")
        return super().step(scan)


class HangingTracker(EchoTracker):
    def step(self, scan: Scan) -> Tracks:
        if scan.time_s > 0.5:
            time.sleep(3600)
        return super().step(scan)


class DyingTracker(EchoTracker):
    def step(self, scan: Scan) -> Tracks:
        if scan.time_s > 0.5:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().step(scan)


def raising(setting: TrackerSetting, options: Mapping[str, object]) -> RaisingTracker:
    return RaisingTracker(setting)


def hanging(setting: TrackerSetting, options: Mapping[str, object]) -> HangingTracker:
    return HangingTracker(setting)


def dying(setting: TrackerSetting, options: Mapping[str, object]) -> DyingTracker:
    return DyingTracker(setting)
