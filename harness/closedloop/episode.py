"""One episode: five seconds of tracking while SUMO drives the ego, then a drive by the belief.

The loop that hands snapshots to the tracker is the one of every run (``harness.running.follow``): it asks for the next
snapshot only when the tracks of the last have been watched, and by then the driver has acted on them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from harness.closedloop.beliefs import (
    TRUTH,
    Perception,
    TrackedPerception,
    TruePerception,
    ego_of,
    true_bodies,
)
from harness.closedloop.episode_start import EpisodeStart
from harness.closedloop.inview import SeldomDetected
from harness.closedloop.passing import Passage
from harness.closedloop.plan import CROSS, DRIVEN_S, STREAMS, TRACKED_S, PlannedDrive
from harness.closedloop.steering import Steering
from harness.closedloop.traffic import LiveTraffic, with_ego
from harness.closedloop.withheld_ahead import PlainSight
from harness.decisions.belief import Belief, Others, believe
from harness.decisions.bodies import Bodies, Egos
from harness.decisions.decide import Decision, decide_by, driver_of, with_doubt
from harness.decisions.drivers.protocol import Driver
from harness.decisions.yielding import EgoPath
from harness.running.evaluate import Evaluated, evaluation_of
from harness.running.snapshots import SnapshotStream
from harness.running.unseen import UnseenOfTracks
from harness.scoring.metrics.closedloop import (
    BY_COLLISION,
    IN_TIME,
    Contact,
    DriveRecord,
    score_crossing,
    score_drive,
)
from harness.sensor.detector import build_sensor
from harness.sensor.observation import Sensor, Snapshot
from harness.sensor.profiles import sensor_settings
from harness.trackers.protocol import AnyTracker
from harness.truth.frame import Frame
from harness.truth.sumo.session import sumo_errors_in_words
from mmpf.tracks import Tracks
from mmpf.undetected.intensity import Unseen

SENSOR, TRACKER = range(2)
"""Streams of an episode's randomness; none depends on the belief."""
WithStops = Callable[[Belief], Belief]
"""What becomes of a belief on the way to where the ego must yield."""


def run_episode(
    traffic: LiveTraffic, at: EpisodeStart, planned: PlannedDrive
) -> tuple[dict[str, dict[str, Any]], Evaluated | None]:
    """Drive an episode from its start, at which the simulation stands; the simulation is used up.

    Returns:
        The tables ``episode`` and ``drive`` of its row, and the scores of one that ended in a collision, else None.
    """
    config, seed = planned.config, planned.config.seed
    stream = np.random.SeedSequence(seed, spawn_key=(STREAMS[at.kind],))
    figures = sensor_settings(config.sensor.profile, config.sensor.overrides)
    sensor = build_sensor(figures)
    if planned.detected is not None:
        sensor = SeldomDetected(sensor, at.provoked, planned.detected, figures)
    road = traffic.network.road
    loop = _Loop(
        traffic=traffic,
        at=at,
        planned=planned,
        driver=driver_of(config.decisions.driver),
        perception=TruePerception() if planned.variant == TRUTH else TrackedPerception(road),
        sensor=sensor,
        noise=_child(stream, SENSOR),
        passage=at.route.passage(traffic.step_s, planned.heed_unseen),
    )
    snapshots = SnapshotStream(
        road=road,
        step_s=traffic.step_s,
        expected_steps=round((TRACKED_S + DRIVEN_S) / traffic.step_s) + 1,
        sensor=sensor.model(road),
        stream=loop.snapshots(),
    )
    evaluation = evaluation_of(config, snapshots)
    if planned.heed_unseen is not None and loop.passage is not None and planned.variant != TRUTH:
        loop.unseen = UnseenOfTracks(evaluation.snapshots.road, evaluation.snapshots.sensor)
    evaluation.follow((loop.watch,), _child(stream, TRACKER))
    drove = score_drive(loop.driven(), loop.ended, loop.contact)
    if loop.passage is not None and loop.passage.crossings:
        drove |= score_crossing(loop.passage.crossed(at.provoked if at.kind == CROSS else "", loop.contact))
    episode: dict[str, Any] = {
        "ego": at.ego,
        "provoked": at.provoked or None,
        "candidates": at.candidates,
        "looked_through": at.looked_through,
    }
    if planned.flow_mps is not None:
        episode["flow_mps"] = planned.flow_mps
    if at.seen_before is not None:
        episode["seen_before"] = float(at.seen_before)
    table = {"episode": episode, "drive": drove}
    return table, evaluation.finish() if loop.ended == BY_COLLISION else None


@dataclass
class _Loop:
    """The ego and its traffic, step by step: snapshots go out, tracks come in, and what the driver does is done."""

    traffic: LiveTraffic
    at: EpisodeStart
    planned: PlannedDrive
    driver: Driver
    perception: Perception
    sensor: Sensor
    noise: np.random.SeedSequence
    ended: str = IN_TIME
    contact: Contact | None = None
    passage: Passage | None = None
    unseen: UnseenOfTracks | None = None
    sight: PlainSight = field(default_factory=PlainSight)
    _steps: list[tuple[float, ...]] = field(default_factory=list)
    _demand: float = 0.0

    def snapshots(self) -> Iterator[Snapshot]:
        """Yield the tracking seconds, then what comes of the driver's commands, until the episode is over."""
        for frame in self.at.frames:
            yield self._observe(frame)
        steering = Steering(self.traffic.running.sumo, self.at)
        steering.take_over()
        first = len(self.at.frames)
        for step in range(first, first + round(DRIVEN_S / self.traffic.step_s)):
            with sumo_errors_in_words(self.traffic.running.sumo):
                steering.act(self._demand, float(self._frame.speed_mps[self._frame.ego]), self.traffic.step_s)
            frame, time_s = self.traffic.advance(), round((step - first + 1) * self.traffic.step_s, 6)
            if self.at.ego not in frame.vehicle_id:
                # Where the user's configuration lets SUMO take away who collides, it is gone by now.
                self.contact = steering.contact(self._frame, time_s)
                self.ended = self.at.route.ended if self.contact is None else BY_COLLISION
                return
            frame = with_ego(frame, self.at.ego, step, self.traffic.step_s)
            self.contact = steering.contact(frame, time_s)
            yield self._observe(frame)
            if self.contact is not None:
                self.ended = BY_COLLISION
                return
            if self.at.route.is_at_end(frame):
                self.ended = self.at.route.ended
                return

    def watch(self, snapshot: Snapshot, tracks: Tracks, tracker: AnyTracker) -> None:
        """Let the driver decide by the tracks, and note what it would do by the truth."""
        bodies = self.perception.bodies(snapshot, tracks)
        self.sight.note(snapshot)
        unseen = None if self.unseen is None else self.unseen.after(snapshot.observation.scan, tracks, tracker)
        if snapshot.frame.step < len(self.at.frames) - 1:
            return
        ego, real = ego_of(snapshot.frame, self.at.route.lanes), true_bodies(snapshot.frame)
        sure = bodies.sure()
        with_stops, really = self._pass(snapshot.frame, sure, real, ego, unseen)
        self._demand, _ = self._demanded(bodies, ego, with_stops)
        needed, leader = self._demanded(real, ego, really)
        self._steps.append(
            (
                float(ego.speed_mps[0]),
                float(leader.gap_m[0]),
                float(leader.speed_mps[0]),
                self._demand,
                needed,
                self._is_withheld(snapshot, int(leader.body[0]), bodies),
            )
        )

    def _is_withheld(self, snapshot: Snapshot, leader: int, told: Bodies) -> bool:
        """Return whether the tracker fails to report the vehicle directly ahead, a true body; -1 for none."""
        if leader < 0 or self.planned.variant == TRUTH:
            return False
        others = np.flatnonzero(np.arange(len(snapshot.frame)) != snapshot.frame.ego)
        return self.sight.withholds(snapshot, int(others[leader]), told)

    def _pass(
        self, frame: Frame, told: Bodies, real: Bodies, ego: Egos, unseen: Unseen | None
    ) -> tuple[WithStops, WithStops]:
        """Return how the ego approaches the place where it must yield, by its belief and by the truth."""
        passage = self.passage
        if passage is None:
            flow_mps = self.planned.flow_mps
            with_stops = (lambda belief: belief) if flow_mps is None else partial(_limited, flow_mps=flow_mps)
            return with_stops, with_stops
        course = EgoPath.of(passage.route, ego)
        holds, must = passage.room_m(course, told, unseen), passage.room_m(course, real)
        passage.note(frame, course, real, holds is not None, must is not None)
        by_belief, by_truth = (partial(passage.with_stops, course=course, room_m=room_m) for room_m in (holds, must))
        return by_belief, by_truth

    def _demanded(self, bodies: Bodies, ego: Egos, with_stops: WithStops) -> tuple[float, Others]:
        """Return the acceleration that the driver demands, and the ego's leader."""
        road, sure = self.traffic.network.road, bodies.sure()

        def decided(by: Bodies) -> Decision:
            return decide_by(self.driver, with_stops(believe(by, ego, road)))

        decision = decided(sure)
        both = with_doubt(decision, decided(bodies)) if bodies.has_doubtful else decision.command.accel_mps2
        return float(both[0]), believe(sure, ego, road).leader

    def driven(self) -> DriveRecord:
        """Return the steps from the start of the episode on."""
        speed, gap, leader, demanded, needed, withheld = np.array(self._steps).T
        return DriveRecord(speed, gap, leader, demanded, needed, self.traffic.step_s, withheld > 0.0)

    def _observe(self, frame: Frame) -> Snapshot:
        """Let the sensor look; what it draws depends on the episode and the step alone, whatever was drawn before."""
        self._frame = frame
        rng = np.random.default_rng(_child(self.noise, frame.step))
        return Snapshot(frame, self.sensor.observe(frame, self.traffic.network.road, rng))


def _limited(belief: Belief, flow_mps: float) -> Belief:
    """Return the belief of a driver who drives at most as fast as the traffic."""
    return replace(belief, speed_limit_mps=np.full(len(belief), flow_mps))


def _child(stream: np.random.SeedSequence, number: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(stream.entropy, spawn_key=(*stream.spawn_key, number))
