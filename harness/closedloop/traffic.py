"""Traffic on its way: a simulation that is read step by step, with the frames of the last seconds."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from harness.closedloop.plan import TRACKED_S
from harness.truth.frame import Frame
from harness.truth.network.network import Network
from harness.truth.sumo.causal import CausalFilter
from harness.truth.sumo.presentplane import PresentPlane
from harness.truth.sumo.reading import read_frame
from harness.truth.sumo.running import RunningSumo
from harness.truth.sumo.session import sumo_errors_in_words


class Traffic:
    """A simulation that is read step by step, with the frames of the last seconds.

    Attributes:
        running: The simulation.
        network: Where it drives.
        step_s: Time between frames.
        frames: The last frames, up to the present one; none has an ego.
    """

    def __init__(self, running: RunningSumo, network: Network, step_s: float, has_persons: bool = False) -> None:
        """Take over a simulation whose warm-up is done, and read its first frame."""
        self.running, self.network, self.step_s = running, network, step_s
        plane = network.plane
        self._plane = None if plane is None else PresentPlane(running.sumo, plane, has_persons)
        self._filter = CausalFilter(step_s)
        self._step = 0
        self.frames: deque[Frame] = deque(maxlen=round(TRACKED_S / step_s) + 1)
        self._read()

    def advance(self) -> Frame:
        """Go a step on and return the frame."""
        self.running.advance()
        self._step += 1
        return self._read()

    def _read(self) -> Frame:
        with sumo_errors_in_words(self.running.sumo):
            time_s = round(self._step * self.step_s, 6)
            if self._plane is None:
                raw = read_frame(self.running.sumo, self.network.corridor_road, self._step, time_s)
            else:
                raw = self._plane.read(self._step, time_s)
        self.frames.append(self._filter.filtered(raw))
        return self.frames[-1]


def with_ego(frame: Frame, ego: str, step: int, step_s: float) -> Frame:
    """Return a frame as the given one of an episode of that ego."""
    return replace(frame, step=step, time_s=round(step * step_s, 6), ego=row_of(frame, ego))


def row_of(frame: Frame, name: str) -> int:
    """Return the row of a vehicle that is in the frame."""
    return int(np.flatnonzero(frame.vehicle_id == name)[0])
