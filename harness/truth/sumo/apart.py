"""Runs SUMO on an external network in a child process that cannot write, hang or crash this one."""

from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from harness.common.isolation import ProcessLimits, Send, confine, streamed
from harness.truth.frame import Frame, TruthSource
from harness.truth.network.limits import check_xml
from harness.truth.network.network import Network


class TrafficApart:
    """Frames of a simulation in another process, as a ``TruthSource``."""

    def __init__(self, network: Network, start: Callable[[Callable[[], None]], TruthSource]) -> None:
        """Start the simulation and let it warm up.

        Raises:
            InputError: SUMO refuses the input or crashes over it.
            RunError: No vehicle ever appears.
        """
        self.road = network.road
        self._folder = TemporaryDirectory(prefix="harness-sumo-")
        folders = (Path(self._folder.name),)

        def drive(send: Send[Any]) -> None:
            if not confine(folders):
                check_xml(*network.files, names_no_place=True)
            truth = start(lambda: send(None))
            send((truth.step_s, truth.expected_steps))
            for frame in truth.frames():
                send(frame)

        self._told = streamed(drive, f"`net`: {network.name}", ProcessLimits.for_files(network.files), folders)
        try:
            self.step_s, self.expected_steps = next(self._told)
        except BaseException:
            self.close()
            raise

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order."""
        yield from self._told

    def close(self) -> None:
        """End the simulation; harmless to call twice."""
        self._told.close()
        self._folder.cleanup()
