"""The one libsumo simulation that a process may have: start, stop, and errors in our words."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from types import ModuleType

from harness.errors import RunError, UserError

QUIET = ("--no-warnings", "true", "--no-step-log", "true", "--duration-log.disable", "true", "--verbose", "false")


def start_sumo(arguments: Sequence[str], step_s: float, seed: int) -> ModuleType:
    """Start SUMO in this process and return the ``libsumo`` module.

    Raises:
        UserError: SUMO refuses its input.
        RunError: A simulation is already open in this process.
    """
    with _silent_native_streams():
        import libsumo  # noqa: PLC0415  (heavy)

    if libsumo.isLoaded():
        raise RunError("a SUMO simulation is open already; a process can hold one at a time")
    fixed = ("--step-length", f"{step_s:g}", "--seed", str(seed), "--step-method.ballistic", "true")
    try:
        with _silent_native_streams():
            libsumo.start(["sumo", *arguments, *fixed, *QUIET])
    except libsumo.TraCIException as error:
        stop_sumo(libsumo)
        raise UserError(f"--net: SUMO refuses the input: {_one_line(error)}") from error
    except libsumo.FatalTraCIError as error:
        raise UserError(f"--net: SUMO refuses the input: {_one_line(error)}") from error
    module: ModuleType = libsumo
    return module


def step_sumo(sumo: ModuleType) -> None:
    """Advance by one step.

    Raises:
        RunError: SUMO fails.
    """
    try:
        sumo.simulationStep()
    except (sumo.TraCIException, sumo.FatalTraCIError) as error:
        raise RunError(f"SUMO failed: {_one_line(error)}") from error


def stop_sumo(sumo: ModuleType) -> None:
    """Close the simulation; harmless where none is open."""
    with suppress(sumo.TraCIException, sumo.FatalTraCIError), _silent_native_streams():
        if sumo.isLoaded():
            sumo.close()


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


@contextmanager
def _silent_native_streams() -> Iterator[None]:
    """Keep what the C++ side writes to the process's own streams away from the user's screen and from ``--json``."""
    sys.stdout.flush()
    sys.stderr.flush()
    saved = os.dup(1), os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os.dup2(saved[0], 1)
        os.dup2(saved[1], 2)
        for descriptor in (*saved, nowhere):
            os.close(descriptor)
