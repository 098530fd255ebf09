"""The co-simulation loop: truth moves, the sensor looks, the tracker follows, the recorder writes it down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from harness.running.memory import keep_freed_memory
from harness.sensor.observation import Observation, Sensor
from harness.trackers.protocol import Tracker, TrackerSetting, TruthAssociatedTracker
from harness.truth.frame import Frame, TruthSource
from mmpf.tracks import Tracks

AnyTracker = Tracker | TruthAssociatedTracker
Watch = Callable[[Frame, Observation, Tracks, AnyTracker], object]


@dataclass(frozen=True)
class Streams:
    """The run's independent streams of randomness, so that changing one part leaves the others' draws as they were.

    Attributes:
        truth: For the traffic.
        sensor: For the sensor's noise.
        tracker: Parent of one child for each episode's tracker.
    """

    truth: np.random.SeedSequence
    sensor: np.random.SeedSequence
    tracker: np.random.SeedSequence

    @classmethod
    def from_seed(cls, seed: int) -> Streams:
        """Return the three streams of a root seed."""
        return cls(*np.random.SeedSequence(seed).spawn(3))


@dataclass(frozen=True)
class StageTimes:
    """Wall time of each stage in each step, seconds; lists of equal length after a finished step."""

    truth_s: list[float] = field(default_factory=list)
    sensor_s: list[float] = field(default_factory=list)
    tracker_s: list[float] = field(default_factory=list)


class Recorder(Protocol):
    """Takes in what happened, step by step."""

    def add(self, frame: Frame, observation: Observation, tracks: Tracks) -> None:
        """Record one step."""
        ...


class TrackerBuilder(Protocol):
    """Builds the tracker of one episode."""

    def __call__(self, setting: TrackerSetting) -> AnyTracker:
        """Return a fresh tracker."""
        ...


def co_simulate(
    truth: TruthSource,
    sensor: Sensor,
    build_tracker: TrackerBuilder,
    recorder: Recorder,
    streams: Streams,
    watch: Watch | None = None,
    times: StageTimes | None = None,
) -> StageTimes:
    """Run truth, sensor and tracker step by step until the truth ends.

    Each episode, that is each ego, gets a new tracker with its own stream; track identities stay unique over the run.

    Args:
        truth: Yields the frames.
        sensor: Looks at them.
        build_tracker: Called at the start of each episode.
        recorder: Takes in every finished step.
        streams: Randomness of sensor and tracker; the truth has used its own when it was opened.
        watch: Called after every step with the frame, the observation, the tracks and the tracker.
        times: Filled in step by step, so that they survive an interrupt; new if None.

    Returns:
        The wall times of the stages.
    """
    times = times if times is not None else StageTimes()
    keep_freed_memory()
    # The filter's matrix products are small: a second BLAS thread costs more than it gives, far more on a busy machine.
    with threadpool_limits(limits=1, user_api="blas"):
        _run_loop(truth, sensor, build_tracker, recorder, streams, watch, times)
    return times


def _run_loop(
    truth: TruthSource,
    sensor: Sensor,
    build_tracker: TrackerBuilder,
    recorder: Recorder,
    streams: Streams,
    watch: Watch | None,
    times: StageTimes,
) -> None:
    sensor_rng = np.random.default_rng(streams.sensor)
    episodes = _EpisodeTrackers(truth, sensor, build_tracker, streams.tracker)
    frames = iter(truth.frames())
    while True:
        begin = perf_counter()
        frame = next(frames, None)
        if frame is None:
            return
        moved = perf_counter()
        observation = sensor.observe(frame, truth.road, sensor_rng)
        sensed = perf_counter()
        episodes.ready_for(frame.episode, observation)
        ready = perf_counter()
        tracks = episodes.step(observation)
        tracked = perf_counter()
        recorder.add(frame, observation, tracks)
        times.truth_s.append(moved - begin)
        times.sensor_s.append(sensed - moved)
        times.tracker_s.append(tracked - ready)
        if watch is not None:
            watch(frame, observation, tracks, episodes.tracker)


@dataclass
class _EpisodeTrackers:
    """The tracker of the present episode, and the identities that earlier ones used up."""

    truth: TruthSource
    sensor: Sensor
    build_tracker: TrackerBuilder
    stream: np.random.SeedSequence
    episode: int | None = None
    tracker: AnyTracker = field(init=False)
    first_free_id: int = 0
    id_offset: int = 0

    def ready_for(self, episode: int, observation: Observation) -> None:
        """Put a new tracker in place if the episode is a new one."""
        if episode == self.episode:
            return
        if self.episode is None:
            self._compile_once(observation)
        self.episode = episode
        self.id_offset = self.first_free_id
        self.tracker = self._fresh_tracker(self.stream.spawn(1)[0])

    def step(self, observation: Observation) -> Tracks:
        """Give the tracker one scan and make its identities unique over the run."""
        tracks = _step_tracker(self.tracker, observation)
        if not len(tracks):
            return tracks
        unique = replace(tracks, track_id=tracks.track_id + self.id_offset)
        self.first_free_id = max(self.first_free_id, int(unique.track_id.max()) + 1)
        return unique

    def _fresh_tracker(self, stream: np.random.SeedSequence) -> AnyTracker:
        setting = TrackerSetting(
            road=self.truth.road,
            sensor=self.sensor.model(),
            rng=np.random.default_rng(stream),
            step_s=self.truth.step_s,
        )
        return self.build_tracker(setting)

    def _compile_once(self, observation: Observation) -> None:
        """Step a tracker that is thrown away, so that compiling kernels counts in no measured step."""
        rehearsal = self._fresh_tracker(np.random.SeedSequence(0))
        for step in range(3):
            scan = replace(observation.scan, time_s=observation.scan.time_s + step * self.truth.step_s)
            _step_tracker(rehearsal, replace(observation, scan=scan))


def _step_tracker(tracker: AnyTracker, observation: Observation) -> Tracks:
    if isinstance(tracker, TruthAssociatedTracker):
        return tracker.step_associated(observation.scan, observation.truth_id)
    return tracker.step(observation.scan)
