"""Trackers that fail in the ways that a grid must outlive."""

import os
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from harness.trackers.protocol import TrackerSetting
from mmpf.scan import Scan
from mmpf.tracks import Tracks
from tests.harness.stand_ins import EchoTracker


@dataclass
class FailingTracker(EchoTracker):
    """Fails in the given way after half a second."""

    fail: Callable[[], object] = field(kw_only=True)

    def step(self, scan: Scan) -> Tracks:
        if scan.time_s > 0.5:
            self.fail()
        return super().step(scan)


def lose_weights() -> None:
    raise ArithmeticError("the weights\nall vanished")


def raising(setting: TrackerSetting, options: Mapping[str, object]) -> FailingTracker:
    return FailingTracker(setting, fail=lose_weights)


def hanging(setting: TrackerSetting, options: Mapping[str, object]) -> FailingTracker:
    return FailingTracker(setting, fail=lambda: time.sleep(3600))


def dying(setting: TrackerSetting, options: Mapping[str, object]) -> FailingTracker:
    return FailingTracker(setting, fail=lambda: os.kill(os.getpid(), signal.SIGKILL))
