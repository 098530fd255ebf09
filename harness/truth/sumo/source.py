"""What every truth from SUMO is: a simulation that advances step by step and is closed once."""

from __future__ import annotations

from collections.abc import Callable

from harness.truth.frame import STEP_S
from harness.truth.sumo.session import Sumo, stop_sumo, sumo_errors_in_words
from mmpf.road import Road

FIRST_VEHICLE_WITHIN_S = 900.0


class SumoSource:
    """A running SUMO simulation.

    Attributes:
        road: The road frame.
        step_s: Time between frames.
        expected_steps: How many frames there will be.
        on_close: Called once the simulation has ended.
    """

    def __init__(self, sumo: Sumo, road: Road, steps: int) -> None:
        """Take over a simulation that has started."""
        self.road = road
        self.step_s = STEP_S
        self.expected_steps = steps
        self._sumo = sumo
        self._open = True
        self.on_close: Callable[[], None] = lambda: None

    def close(self) -> None:
        """End the simulation; harmless to call twice."""
        if self._open:
            self._open = False
            stop_sumo(self._sumo)
            self.on_close()

    def _advance(self) -> None:
        with sumo_errors_in_words(self._sumo):
            self._before_step()
            self._sumo.simulationStep()

    def _before_step(self) -> None:
        """Do what is to be done before each of SUMO's steps."""
