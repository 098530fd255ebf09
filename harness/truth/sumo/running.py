"""A running simulation: it goes on step by step, and is ended once."""

from __future__ import annotations

from collections.abc import Callable

from harness.truth.sumo.session import Sumo, stop_sumo, sumo_errors_in_words

FIRST_VEHICLE_WITHIN_S = 900.0
"""How long a truth from SUMO waits for its first vehicle."""


class RunningSumo:
    """A SUMO simulation that has started.

    Attributes:
        sumo: Its interface.
        before_step: Called before each of its steps, with its time in seconds.
    """

    def __init__(self, sumo: Sumo, on_close: Callable[[], None], on_step: Callable[[], None] | None = None) -> None:
        """Take over a simulation.

        Args:
            sumo: Its interface.
            on_close: Called once, when it has ended.
            on_step: Called after each step.
        """
        self.sumo = sumo
        self.before_step: Callable[[float], None] = lambda _: None
        self._on_close, self._on_step = on_close, on_step
        self._open = True

    def advance(self) -> None:
        """Go one step on.

        Raises:
            SumoError: SUMO can't.
        """
        with sumo_errors_in_words(self.sumo):
            self.before_step(self.sumo.simulation.getTime())
            self.sumo.simulationStep()
        if self._on_step is not None:
            self._on_step()

    def close(self) -> None:
        """End it; harmless to call twice."""
        if self._open:
            self._open = False
            stop_sumo(self.sumo)
            self._on_close()
