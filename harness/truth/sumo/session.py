"""The one simulation of a run, in this process or in a window: start, stop and error messages."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from harness.common.errors import InputError, RunError, SumoError
from harness.common.streams import streams_and_depth_kept
from harness.truth.frame import STEP_S
from harness.truth.sumo.window import STDERR, SumoWindow, first_error, open_window, written

FIRST_VEHICLE_WITHIN_S = 900.0
"""How long a truth from SUMO waits for its first vehicle."""
QUIET = ("--no-warnings", "true", "--no-step-log", "true", "--duration-log.disable", "true", "--verbose", "false")


class Sumo(Protocol):
    """What is used of SUMO's interface: of the module ``libsumo``, or of ``harness.truth.sumo.window.SumoWindow``."""

    vehicle: Any
    person: Any
    lane: Any
    edge: Any
    route: Any
    simulation: Any
    trafficlight: Any
    TraCIException: type[Exception]
    FatalTraCIError: type[Exception]

    def simulationStep(self) -> object:  # noqa: N802  (SUMO's name)
        """Advance by one step."""

    def isLoaded(self) -> bool:  # noqa: N802  (SUMO's name)
        """Whether a simulation is open."""

    def close(self) -> None:
        """End the simulation."""


def start_sumo(arguments: Sequence[str], seed: int, gui: bool = False) -> Sumo:
    """Start SUMO in this process, or sumo-gui beside it, and return its interface.

    Raises:
        InputError: SUMO refuses its input, or no window can be opened.
        RunError: A simulation is already open in this process.
    """
    fixed = ("--step-length", f"{STEP_S:g}", "--seed", str(seed), "--step-method.ballistic", "true")
    if gui:
        return open_window([*arguments, *fixed, *QUIET])
    with _silent_native_streams():
        import libsumo  # noqa: PLC0415  (heavy)

    if libsumo.isLoaded():
        raise RunError("a SUMO simulation is open already; a process can hold one at a time")
    with TemporaryDirectory(prefix="harness-sumo-") as folder:
        try:
            with _silent_native_streams(Path(folder) / STDERR):
                libsumo.start(["sumo", *arguments, *fixed, *QUIET])
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            if isinstance(error, libsumo.TraCIException):
                stop_sumo(libsumo)
            reason = first_error(written(Path(folder))) or _one_line(error)
            raise InputError(f"`net`: SUMO refuses the input: {reason}") from error
    sumo: Sumo = libsumo
    return sumo


@contextmanager
def sumo_errors_in_words(sumo: Sumo) -> Iterator[None]:
    """Turn what SUMO raises inside into our own errors.

    Raises:
        SumoError: SUMO fails.
        RunError: The user has closed its window.
    """
    try:
        yield
    except (sumo.TraCIException, sumo.FatalTraCIError, ConnectionError) as error:
        if isinstance(sumo, SumoWindow) and not isinstance(error, sumo.TraCIException):
            raise RunError(sumo.how_it_ended()) from error
        raise SumoError(_one_line(error)) from error


def show_ego(sumo: Sumo, vehicle_id: str) -> None:
    """Let the window, if there is one, follow a vehicle."""
    if isinstance(sumo, SumoWindow):
        sumo.follow(vehicle_id)


def stop_sumo(sumo: Sumo) -> None:
    """Close the simulation; harmless where none is open."""
    with suppress(sumo.TraCIException, sumo.FatalTraCIError), _silent_native_streams():
        if sumo.isLoaded():
            sumo.close()


class RunningSumo:
    """A started SUMO simulation, advanced step by step; ``before_step`` gets the time in seconds before each."""

    def __init__(self, sumo: Sumo, on_close: Callable[[], None], on_step: Callable[[], None] | None = None) -> None:
        """Take over a simulation; call ``on_step`` after each step, and ``on_close`` once, when it has ended."""
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


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


@contextmanager
def _silent_native_streams(complaints: Path | None = None) -> Iterator[None]:
    """Keep what C++ writes off the streams; the file ``complaints`` takes what goes to standard error."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    told = nowhere if complaints is None else os.open(complaints, os.O_WRONLY | os.O_CREAT, 0o600)
    with streams_and_depth_kept():
        os.dup2(nowhere, 1)
        os.dup2(told, 2)
        for descriptor in {nowhere, told}:
            os.close(descriptor)
        yield
