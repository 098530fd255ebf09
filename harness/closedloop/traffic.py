"""A running simulation that is read step by step and keeps the frames of the last seconds."""

from collections import deque
from dataclasses import replace

import numpy as np

from harness.closedloop.plan import TRACKED_S
from harness.truth.frame import Frame
from harness.truth.network.network import Network
from harness.truth.sumo.simulation import SumoTruth


class LiveTraffic:
    """A simulation that is read step by step, with the frames of the last seconds, none of which has an ego."""

    def __init__(self, truth: SumoTruth, network: Network) -> None:
        """Take over a simulation whose warm-up is done, and read its first frame."""
        self.running, self.network, self.step_s = truth.running, network, truth.step_s
        self._truth, self._step = truth, 0
        self.frames: deque[Frame] = deque([truth.present(0)], maxlen=round(TRACKED_S / truth.step_s) + 1)

    def advance(self) -> Frame:
        """Go a step on and return the frame."""
        self.running.advance()
        self._step += 1
        self.frames.append(self._truth.present(self._step))
        return self.frames[-1]


def with_ego(frame: Frame, ego: str, step: int, step_s: float) -> Frame:
    """Return a frame as the given one of an episode of that ego."""
    return replace(frame, step=step, time_s=round(step * step_s, 6), ego=row_of(frame, ego))


def row_of(frame: Frame, name: str) -> int:
    """Return the row of a vehicle that is in the frame."""
    return int(np.flatnonzero(frame.vehicle_id == name)[0])
