"""Where episodes begin: which car becomes the ego, and whom a provocation concerns.

A seed's traffic runs on under SUMO's own drivers. Of the last five seconds every frame is kept, so that a car that is
chosen now has been followed since then: its sensor is made to look at those frames in their order.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.closedloop.plan import BRAKE, DRIVEN_S, FREE, TRACKED_S
from harness.decisions.belief import Belief, believe
from harness.decisions.bodies import Bodies, Egos
from harness.sensor.detector import visibility_of
from harness.sensor.scene import box_axes, in_reach, sight_to
from harness.sensor.settings import SensorSettings
from harness.truth.frame import Frame
from harness.truth.network.network import Network
from harness.truth.sumo.causal import CausalFilter
from harness.truth.sumo.reading import read_frame
from harness.truth.sumo.running import RunningSumo
from harness.truth.sumo.session import sumo_errors_in_words
from harness.truth.sumo.simulation import CAR_LENGTH_M
from mmpf.compute.arrays import FloatArray, IntArray

LOOK_AGAIN_S, GIVE_UP_S = 2.0, 40.0
"""Time between moments that are searched for candidates, and after which there are none."""
SECTION_MARGIN_M = 20.0
# An ego needs so much road as it covers in an episode at this speed at most.
ROOM_AT_MPS = 12.0
FARTHEST_LEADER_M, FARTHEST_HIDDEN_M = 40.0, 70.0
CHANGES_LANE_MPS = 0.2
"""Whoever moves sideways faster is about to be somewhere else."""
SLOWEST_MPS = 3.0
"""Whoever is slower does not brake in a way that matters."""
SEEN_EVERY, SEEN_OFTEN = 5, 3
"""A hidden vehicle has been seen if it was in sight at so many of every fifth frame of the tracking seconds."""


class Traffic:
    """A simulation that is read step by step, with the frames of the last seconds.

    Attributes:
        running: The simulation.
        network: Where it drives.
        step_s: Time between frames.
        frames: The last frames, up to the present one; none has an ego.
    """

    def __init__(self, running: RunningSumo, network: Network, step_s: float) -> None:
        """Take over a simulation whose warm-up is done, and read its first frame."""
        self.running, self.network, self.step_s = running, network, step_s
        self._filter = CausalFilter(step_s)
        self._step = 0
        self.frames: deque[Frame] = deque(maxlen=round(TRACKED_S / step_s) + 1)
        self._read()

    def advance(self) -> Frame:
        """Go a step on and return the frame."""
        self.running.advance()
        self._step += 1
        return self._read()

    def _read(self) -> Frame:
        with sumo_errors_in_words(self.running.sumo):
            raw = read_frame(self.running.sumo, self.network.road, self._step, round(self._step * self.step_s, 6))
        self.frames.append(self._filter.filtered(raw))
        return self.frames[-1]


@dataclass(frozen=True)
class HandOver:
    """A moment at which the ego's driver takes over from SUMO's.

    Attributes:
        kind: ``free``, or how the episode is provoked.
        ego: Name of the ego.
        provoked: Name of the vehicle that is provoked; empty for none.
        candidates: How many cars could have been the ego.
        looked_through: How many of them were looked at until one fitted, over all moments.
        frames: The tracking seconds, the last frame is the hand-over's.
    """

    kind: str
    ego: str
    provoked: str
    candidates: int
    looked_through: int
    frames: tuple[Frame, ...]


def hand_overs(
    traffic: Traffic, kinds: Sequence[str], settings: SensorSettings, rng: np.random.Generator
) -> Iterator[HandOver | str]:
    """Yield a hand-over of each kind while the traffic stands at it, in order of time; a kind alone if none is found.

    Args:
        traffic: The traffic; it goes on between hand-overs.
        kinds: Kinds of episodes, each once.
        settings: The sensor.
        rng: Decides between candidates. Each kind has the same draws whichever others are asked for.
    """
    step_s, waiting = traffic.step_s, list(kinds)
    streams = dict(zip((FREE, BRAKE), rng.spawn(2), strict=True))
    looked = dict.fromkeys(waiting, 0)
    for _ in range(round(TRACKED_S / step_s)):
        traffic.advance()
    for _ in range(round(GIVE_UP_S / LOOK_AGAIN_S)):
        for kind in tuple(waiting):
            found = _find(traffic, kind, settings, streams[kind])
            looked[kind] += found.looked_through
            if found.ego:
                waiting.remove(kind)
                yield replace(found, looked_through=looked[kind])
        if not waiting:
            return
        for _ in range(round(LOOK_AGAIN_S / step_s)):
            traffic.advance()
    yield from waiting


def with_ego(frame: Frame, ego: str, step: int, step_s: float) -> Frame:
    """Return a frame as the given one of an episode of that ego."""
    return replace(frame, step=step, time_s=round(step * step_s, 6), ego=_row_of(frame, ego))


def _find(traffic: Traffic, kind: str, settings: SensorSettings, rng: np.random.Generator) -> HandOver:
    """Look for an ego at the present moment; the hand-over's is empty if there is none."""
    now = traffic.frames[-1]
    rows = _eligible(traffic)
    order = rows[rng.permutation(len(rows))]
    belief = _believed_by_each(now, order, traffic)
    for place, row in enumerate(order):
        ego = str(now.vehicle_id[row])
        provoked = "" if kind == FREE else _hidden_second_leader(traffic, belief, place, ego, settings)
        if kind == FREE or provoked:
            frames = (with_ego(frame, ego, step, traffic.step_s) for step, frame in enumerate(traffic.frames))
            return HandOver(kind, ego, provoked, len(rows), place + 1, tuple(frames))
    return HandOver(kind, "", "", len(rows), len(rows), ())


def _eligible(traffic: Traffic) -> IntArray:
    """Return the rows of the present frame that may be the ego: cars with a past that keep to a main lane."""
    now, network, sumo = traffic.frames[-1], traffic.network, traffic.running.sumo
    start_m, end_m = network.section_m
    room_m = DRIVEN_S * np.minimum(now.speed_mps, ROOM_AT_MPS)
    chosen = (now.lon_m > start_m + SECTION_MARGIN_M) & (now.lon_m + room_m < end_m)
    chosen &= (now.length_m >= CAR_LENGTH_M[0]) & (now.length_m <= CAR_LENGTH_M[1])
    chosen &= np.isin(now.lane, np.asarray(network.ego_lanes)) & (now.speed_mps >= SLOWEST_MPS)
    chosen &= np.abs(now.lat_speed_mps) <= CHANGES_LANE_MPS
    past = [set(frame.vehicle_id.tolist()) for frame in list(traffic.frames)[:-1]]
    last = network.main_road.edges[-1].name
    stays = [
        row
        for row in np.flatnonzero(chosen)
        if all(now.vehicle_id[row] in names for names in past)
        and sumo.vehicle.getRoute(str(now.vehicle_id[row]))[-1] == last
    ]
    return np.array(stays, dtype=np.int64)


def _believed_by_each(frame: Frame, rows: IntArray, traffic: Traffic) -> Belief:
    """Return what each of some vehicles would believe by the truth, a step each; bodies are rows of the frame."""
    count, size = len(rows), len(frame)

    def repeated(values: FloatArray) -> FloatArray:
        return np.tile(values, count)

    bodies = Bodies(
        step=np.repeat(np.arange(count), size),
        lon_m=repeated(frame.lon_m),
        lat_m=repeated(frame.lat_m),
        speed_mps=repeated(frame.speed_mps),
        direction_rad=np.zeros(count * size),
        length_m=repeated(frame.length_m),
        width_m=repeated(frame.width_m),
    )
    own = {name: getattr(frame, name)[rows] for name in ("lon_m", "lat_m", "speed_mps", "lane", "length_m", "width_m")}
    return believe(bodies, Egos(episode=np.zeros(count, dtype=np.int64), **own), traffic.network.road)


def _hidden_second_leader(traffic: Traffic, belief: Belief, place: int, ego: str, settings: SensorSettings) -> str:
    """Return the leader's leader if it is hidden now, moves, and was in sight before; else an empty name."""
    now = traffic.frames[-1]
    first, second = (belief.leaders.body[place, rank] for rank in (0, 1))
    gap_m = belief.leaders.gap_m[place]
    if first < 0 or second < 0 or not 0.0 < gap_m[0] <= FARTHEST_LEADER_M or gap_m[1] > FARTHEST_HIDDEN_M:
        return ""
    other = int(second) % len(now)
    name = str(now.vehicle_id[other])
    if now.speed_mps[other] < SLOWEST_MPS or not _is_hidden(now, ego, name, traffic, settings):
        return ""
    before = list(traffic.frames)[:-1:SEEN_EVERY]
    seen = sum(not _is_hidden(frame, ego, name, traffic, settings) for frame in before)
    return name if seen >= SEEN_OFTEN else ""


def _is_hidden(frame: Frame, ego: str, name: str, traffic: Traffic, settings: SensorSettings) -> bool:
    """Return whether less of a vehicle is to be seen than the sensor needs, by true visible fraction."""
    if name not in frame.vehicle_id:
        return True
    road, other = traffic.network.road, _row_of(frame, name)
    seen_from = replace(frame, ego=_row_of(frame, ego))
    pose = seen_from.ego_pose
    sight = sight_to(frame.lon_m, frame.lat_m, road, pose, box_axes(road, frame.heading_rad))
    in_range = in_reach(settings, sight.distance, sight.off_axis)
    fraction, _, _ = visibility_of(seen_from, road, pose, in_range, settings.range_m)
    return bool(fraction[other] < settings.hidden_fraction)


def _row_of(frame: Frame, name: str) -> int:
    return int(np.flatnonzero(frame.vehicle_id == name)[0])
