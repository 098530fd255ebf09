"""SUMO with its own window: sumo-gui as a second process, controlled through TraCI."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout, suppress
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Timer
from typing import TYPE_CHECKING, Any

from harness.common.errors import InputError

if TYPE_CHECKING:
    from traci.connection import Connection


# Twice as fast as the clock at a step of 0.1 s, if the tracker keeps up; the window has a slider for it.
DELAY_MS = 50
OPTIONS = (
    *("--start", "true", "--quit-on-end", "true", "--delay", str(DELAY_MS)),
    *("--window-size", "1200,700", "--window-pos", "40,40"),
)
CONNECT_EVERY_S, CONNECT_WITHIN_S = 0.2, 60.0
CLOSE_WITHIN_S = 3.0
SKY_BLUE, YELLOW = (86, 180, 233), (255, 255, 0)
SHOWN_AROUND_EGO_M = 60.0
# SUMO indents the further lines of a message.
FIRST_ERROR = re.compile(r"^Error: (.*(?:\n .*)*)", re.MULTILINE)
LOG, STDERR = "errors.log", "stderr"
INSTALL = "pip install -c constraints.txt '.[networks]'"


def check_window() -> Path:
    """Return the program sumo-gui, after checking that it can be expected to show its window.

    Raises:
        InputError: There is no screen, sumo-gui is not installed, or it is another version than libsumo.
    """
    if not has_screen(sys.platform, os.environ):
        raise InputError("`gui`: no display is available (neither DISPLAY nor WAYLAND_DISPLAY is set); leave out `gui`")
    package, traci = importlib.util.find_spec("sumo"), importlib.util.find_spec("traci")
    program = _program_in(Path(package.origin).parent) if package is not None and package.origin else None
    if program is None or traci is None:
        raise InputError(f"`gui`: sumo-gui is not installed; install it with: {INSTALL}")
    gui, library = version("eclipse-sumo"), version("libsumo")
    if gui != library:
        raise InputError(
            f"`gui`: sumo-gui {gui} would drive other traffic than libsumo {library}; install the same version with: "
            f"pip install eclipse-sumo=={library}"
        )
    return program


def has_screen(platform: str, environment: Mapping[str, str]) -> bool:
    """Whether a program can open a window, as far as the environment tells; only Linux does."""
    return not platform.startswith("linux") or bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))


def open_window(arguments: Sequence[str]) -> SumoWindow:
    """Start sumo-gui on command-line arguments of SUMO's and return it, running.

    Raises:
        InputError: No window can be opened, or SUMO refuses its input.
    """
    program = check_window()
    from traci.main import getFreeSocketPort  # noqa: PLC0415

    port = getFreeSocketPort()
    complaints = TemporaryDirectory(prefix="sumo-gui-")
    folder = Path(complaints.name)
    with (folder / STDERR).open("wb") as stderr:
        process = subprocess.Popen(
            [str(program), *arguments, *OPTIONS, "--error-log", str(folder / LOG), "--remote-port", str(port)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=stderr,
            env={"SUMO_HOME": str(program.parents[1])} | os.environ,
            # A Ctrl-C is for the harness, which closes the window when it has saved what there is.
            start_new_session=True,
        )
    try:
        return SumoWindow(_connect(port, process, folder), process, complaints)
    except BaseException:
        process.kill()
        process.wait()
        complaints.cleanup()
        raise


def written(folder: Path) -> str:
    """Return what SUMO has written into files of a folder: to its log once it reads files, before to standard error."""
    files = (folder / name for name in (LOG, STDERR))
    texts = (file.read_text(encoding="utf-8", errors="replace").rstrip() for file in files if file.is_file())
    return "\n".join(texts).strip()


def first_error(text: str) -> str:
    """Return the first error that SUMO has written, its further lines included, without the word; empty for none."""
    found = FIRST_ERROR.search(text)
    return " ".join(found.group(1).split())[:400] if found else ""


class SumoWindow:
    """A running sumo-gui, with what is used of the interface of the module ``libsumo``."""

    def __init__(
        self, connection: Connection, process: subprocess.Popen[bytes], complaints: TemporaryDirectory[str]
    ) -> None:
        """Take over a process, the connection to it, and the folder of what it complains of."""
        # libsumo puts a class of its own into traci.exceptions; what a connection raises is its module's.
        from traci.connection import FatalTraCIError, TraCIException  # noqa: PLC0415

        self.TraCIException: type[Exception] = TraCIException
        self.FatalTraCIError: type[Exception] = FatalTraCIError
        self.vehicle: Any = connection.vehicle
        self.person: Any = connection.person
        self.lane: Any = connection.lane
        self.edge: Any = connection.edge
        self.route: Any = connection.route
        self.simulation: Any = connection.simulation
        self.trafficlight: Any = connection.trafficlight
        self._connection = connection
        self._process = process
        self._complaints = complaints
        self._open = True
        self._ego = ""

    def simulationStep(self) -> object:  # noqa: N802  (SUMO's name)
        """Advance by one step."""
        return self._connection.simulationStep()

    def isLoaded(self) -> bool:  # noqa: N802  (SUMO's name)
        """Whether the simulation has not been closed from here."""
        return self._open

    def close(self) -> None:
        """End the simulation and close the window, by force if it does not answer; harmless to call twice."""
        if not self._open:
            return
        self._open = False
        force = Timer(CLOSE_WITHIN_S, self._process.kill)
        force.start()
        try:
            # After a Ctrl-C half an answer may be under way, over which TraCI stumbles with errors of any kind.
            with suppress(Exception):
                self._connection.close(False)
            self._process.wait()
        finally:
            force.cancel()
            self._complaints.cleanup()

    def follow(self, vehicle_id: str) -> None:
        """Move along with a vehicle, the ego, and paint it in a colour of its own."""
        # The frames lag behind the window, so the vehicle may have left the road by now.
        with suppress(self.TraCIException):
            x, y = self.vehicle.getPosition(vehicle_id)
            gui, around = self._connection.gui, SHOWN_AROUND_EGO_M
            gui.setBoundary(gui.DEFAULT_VIEW, x - around, y - around, x + around, y + around)
            gui.trackVehicle(gui.DEFAULT_VIEW, vehicle_id)
            self.vehicle.setColor(vehicle_id, SKY_BLUE)
        with suppress(self.TraCIException):
            if self._ego:
                self.vehicle.setColor(self._ego, YELLOW)
        self._ego = vehicle_id

    def how_it_ended(self) -> str:
        """Return in words why the window does not answer any more."""
        with suppress(subprocess.TimeoutExpired):
            if code := self._process.wait(CLOSE_WITHIN_S):
                error = first_error(written(Path(self._complaints.name)))
                return f"sumo-gui ended with exit code {code}: {error}".removesuffix(": ")
            return "the window of sumo-gui was closed"
        return "sumo-gui no longer answers"


def _program_in(package: Path) -> Path | None:
    programs = (package / "bin" / name for name in ("sumo-gui", "sumo-gui.exe"))
    return next((program for program in programs if program.is_file()), None)


def _connect(port: int, process: subprocess.Popen[bytes], complaints: Path) -> Connection:
    """Return the connection to sumo-gui as soon as it takes one; an ``InputError`` if it ends or takes too long."""
    import traci  # noqa: PLC0415

    tries = round(CONNECT_WITHIN_S / CONNECT_EVERY_S)
    try:
        # TraCI prints each vain attempt, and the first ones are always in vain.
        with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
            connection: Connection = traci.connect(port, tries, proc=process, waitBetweenRetries=CONNECT_EVERY_S)
        connection.simulation.getTime()  # answers only when the network and the vehicles are read
    except (traci.TraCIException, traci.FatalTraCIError, OSError):
        with suppress(subprocess.TimeoutExpired):
            process.wait(CLOSE_WITHIN_S)
        text = written(complaints)
        if error := first_error(text):
            raise InputError(f"`net`: SUMO refuses the input: {error}") from None
        raise InputError(f"`gui`: sumo-gui does not open: {text.split(chr(10))[-1] or 'it does not answer'}") from None
    return connection
