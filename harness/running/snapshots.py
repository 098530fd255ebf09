"""The snapshots of a run: at each step the truth and what the sensor detects of it, live or recorded."""

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Self

import numpy as np

from harness.common.error_text import what_it_raised
from harness.common.errors import InputError, RunError
from harness.common.isolation import ProcessLimits, Send, streamed
from harness.sensor.observation import Observation, Sensor, Snapshot
from harness.storage.manifest import sha256_of
from harness.truth.frame import Frame, TruthSource
from mmpf.map.road import Road
from mmpf.scan import SensorModel

OWN_WORK = ProcessLimits(cpu_s=86_400, confined=False)
"""Of the fork that makes a run's own snapshots; files from others were read before, in a fork that is confined."""


@dataclass(frozen=True)
class RandomStreams:
    """The run's independent streams of randomness, so that changing one part leaves the others' draws as they were.

    Attributes:
        tracker: Parent of one child for each episode's tracker.
        altered: Parent of the streams of what is done to detections afterwards.
    """

    truth: np.random.SeedSequence
    sensor: np.random.SeedSequence
    tracker: np.random.SeedSequence
    altered: np.random.SeedSequence

    @classmethod
    def from_seed(cls, seed: int) -> Self:
        """Return the streams of a root seed."""
        return cls(*np.random.SeedSequence(seed).spawn(4))


@dataclass(frozen=True)
class SnapshotStream:
    """The snapshots of one piece of traffic in order, and what is known beforehand.

    Attributes:
        expected_steps: How many snapshots there are at most, for progress.
        stream: The snapshots, each made when it is asked for; they can be gone through once unless they are ``kept``.
        close: Releases what makes them; harmless to call twice.
        noise_factor: Factor on the deviations that detections report, as trackers are shown them.
        tells_signals: Whether trackers are told the states of the road's signals.
    """

    road: Road
    step_s: float
    expected_steps: int
    sensor: SensorModel
    stream: Iterable[Snapshot]
    close: Callable[[], None] = lambda: None
    files: Mapping[str, Path] = field(default_factory=dict)
    report: str = ""
    about: Mapping[str, object] = field(default_factory=dict)
    noise_factor: float = 1.0
    tells_signals: bool = False

    def __iter__(self) -> Iterator[Snapshot]:
        return iter(self.stream)

    def kept(self) -> Self:
        """Return the same snapshots in memory, to be played to many trackers; none of these pays for making them.

        Raises:
            RunError: The simulation fails, or there is no snapshot.
        """
        try:
            stream = tuple(replace(snapshot, truth_s=0.0, sensor_s=0.0) for snapshot in self)
        finally:
            self.close()
        if not stream:
            raise RunError("the traffic has no ego vehicle in the section")
        return replace(self, stream=stream, expected_steps=len(stream), close=lambda: None)

    def made_ahead(self) -> Self:
        """Return the same snapshots, made in a fork of this process, at most as far ahead as a pipe holds them.

        Going through them raises a RunError where making one fails or the fork is killed.
        """
        stream = _from_fork(self.stream)

        def close() -> None:
            stream.close()
            self.close()

        return replace(self, stream=stream, close=close)

    def hashes(self) -> dict[str, str]:
        """Return the SHA-256 of each file that decided the snapshots."""
        return {name: sha256_of(path) for name, path in self.files.items()}


def _from_fork(stream: Iterable[Snapshot]) -> Generator[Snapshot]:
    def make(send: Send[Snapshot]) -> None:
        try:
            for snapshot in stream:
                send(snapshot)
        except Exception as error:
            raise RunError(str(error) if isinstance(error, InputError | RunError) else what_it_raised(error)) from error

    try:
        yield from streamed(make, "the simulation", OWN_WORK)
    except InputError as error:
        raise RunError(str(error)) from error  # it was killed: the steps so far are kept


def observe_traffic(truth: TruthSource, sensor: Sensor, seed: int) -> SnapshotStream:
    """Let a sensor observe traffic."""
    rng = np.random.default_rng(RandomStreams.from_seed(seed).sensor)
    return SnapshotStream(
        road=truth.road,
        step_s=truth.step_s,
        expected_steps=truth.expected_steps,
        sensor=sensor.model(truth.road),
        stream=timed_snapshots(truth.frames(), lambda frame: sensor.observe(frame, truth.road, rng)),
        close=truth.close,
    )


def timed_snapshots(frames: Iterable[Frame], observe: Callable[[Frame], Observation]) -> Iterator[Snapshot]:
    """Yield a snapshot for each frame on demand, with the wall times of truth and sensor."""
    source = iter(frames)
    while True:
        begin = perf_counter()
        if (frame := next(source, None)) is None:
            return
        moved = perf_counter()
        observation = observe(frame)
        yield Snapshot(frame, observation, truth_s=moved - begin, sensor_s=perf_counter() - moved)
