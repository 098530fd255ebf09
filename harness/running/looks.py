"""Truth and observations of one cell, made once and played to every tracker."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from harness.config.model import RunConfig
from harness.errors import RunError
from harness.running.follow import StageTimes, Streams, co_simulate
from harness.running.open import open_inputs
from harness.sensor.observation import Observation
from harness.truth.frame import Frame
from mmpf.road import Road
from mmpf.scan import SensorModel

if TYPE_CHECKING:
    from harness.runfolder.tables import RunTables


@dataclass
class ObservedTraffic:
    """Plays recorded frames and observations in the roles of both truth and sensor.

    Attributes:
        road: The road.
        step_s: Time between frames.
        sensor: The sensor's data sheet.
        looks: Each frame with what the sensor made of it, in order of their steps.
        expected_steps: How many frames there are.
        about: Tables about the traffic for the metrics, by name.
    """

    road: Road
    step_s: float
    sensor: SensorModel
    looks: tuple[tuple[Frame, Observation], ...]
    expected_steps: int
    about: Mapping[str, object] = field(default_factory=dict)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames."""
        return (frame for frame, _ in self.looks)

    def close(self) -> None:
        """Do nothing: a recording holds nothing open."""

    def model(self) -> SensorModel:
        """Return the data sheet."""
        return self.sensor

    def observe(self, frame: Frame, road: Road, rng: np.random.Generator) -> Observation:  # noqa: ARG002
        """Return what the sensor saw then; draws no random number."""
        return self.looks[frame.step - self.looks[0][0].step][1]


def observe_traffic(config: RunConfig) -> ObservedTraffic:
    """Simulate traffic and sensor, with the very draws that a single run of this configuration makes.

    Raises:
        InputError: Traffic or sensor can't be opened.
        RunError: The simulation fails, or has no ego vehicle.
    """
    streams = Streams.from_seed(config.seed)
    inputs = open_inputs(config, streams)
    rng = np.random.default_rng(streams.sensor)
    try:
        truth = inputs.truth
        looks = tuple((frame, inputs.sensor.observe(frame, truth.road, rng)) for frame in truth.frames())
    finally:
        inputs.truth.close()
    if not looks:
        raise RunError("the traffic has no ego vehicle in the section")
    return ObservedTraffic(truth.road, truth.step_s, inputs.sensor.model(), looks, len(looks), inputs.about)


def track(
    traffic: ObservedTraffic,
    config: RunConfig,
    times: StageTimes,
    on_first_step: Callable[[], None] = lambda: None,
) -> RunTables:
    """Play observed traffic to a tracker and return what a run records.

    Args:
        traffic: Truth and observations.
        config: Names the tracker, and the seed of its randomness.
        times: Filled with the wall times of the stages.
        on_first_step: Called once the first step is done.
    """
    from harness.runfolder.tables import ColumnRecorder  # noqa: PLC0415
    from harness.trackers.catalogue import build_tracker  # noqa: PLC0415

    recorder = ColumnRecorder()
    co_simulate(
        traffic,
        traffic,
        lambda setting: build_tracker(config.tracker.name, setting, config.tracker.all_options()),
        recorder,
        Streams.from_seed(config.seed),
        lambda *_: on_first_step() if recorder.steps == 1 else None,
        times,
    )
    return recorder.tables()
