"""Chooses where an episode starts: the ego, and the vehicle that a provocation acts on.

A seed's traffic runs on under SUMO's own drivers. Of the last five seconds every frame is kept, so that a car that is
chosen now has been followed since then: its sensor is made to look at those frames in their order.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.closedloop.candidates import candidates_of
from harness.closedloop.plan import BRAKE, CROSS, DARK, FREE, STOPPED, STREAMS, TRACKED_S
from harness.closedloop.routes import EgoRoute
from harness.closedloop.traffic import LiveTraffic, with_ego
from harness.config.sensor import SensorSettings
from harness.truth.frame import Frame
from harness.truth.sumo.fill import Placement

LOOK_AGAIN_S = {FREE: 2, BRAKE: 2, CROSS: 1, STOPPED: 1, DARK: 2}
"""Time between moments that are searched for candidates of each kind."""
GIVE_UP_S = {FREE: 40, BRAKE: 40, CROSS: 600, STOPPED: 120, DARK: 40}
"""After so long there are none."""


@dataclass(frozen=True)
class EpisodeStart:
    """A moment at which the ego's driver takes over from SUMO's.

    Attributes:
        kind: ``free``, or how the episode is provoked.
        provoked: Name of the vehicle that is provoked; empty for none.
        candidates: How many cars could have been the ego.
        looked_through: How many of them were looked at until one fitted, over all moments.
        frames: The tracking seconds, the last frame is the start's.
        route: Where the ego is to drive.
        seen_before: Whether the vehicle that it must let pass had been in sight, or never had; None for other kinds.
        stands: Where the vehicle is put that is to stand in the ego's way; None for other kinds.
    """

    kind: str
    ego: str
    provoked: str
    candidates: int
    looked_through: int
    frames: tuple[Frame, ...]
    route: EgoRoute
    seen_before: bool | None = None
    stands: Placement | None = None


def episode_starts(
    traffic: LiveTraffic,
    kinds: Sequence[str],
    settings: SensorSettings,
    rng: np.random.Generator,
    flow_mps: float | None = None,
) -> Iterator[EpisodeStart | str]:
    """Yield a start of each kind while the traffic stands at it, in order of time; a kind alone if none is found.

    Args:
        traffic: The traffic; it goes on between starts of episodes.
        kinds: Kinds of episodes, each once.
        settings: The sensor.
        rng: Decides between candidates. Each kind has the same draws whichever others are asked for.
        flow_mps: Speed at which the traffic is to flow; None where it is not told.
    """
    step_s = traffic.step_s
    waiting = [kind for kind in kinds if candidates_of(traffic, kind, settings, flow_mps).possible]
    spawned = rng.spawn(max(STREAMS.values()) + 1)
    hopeless, looked = [kind for kind in kinds if kind not in waiting], dict.fromkeys(waiting, 0)
    for _ in range(round(TRACKED_S / step_s)):
        traffic.advance()
    for second in range(max(GIVE_UP_S[kind] for kind in kinds)):
        for kind in [kind for kind in waiting if second < GIVE_UP_S[kind] and second % LOOK_AGAIN_S[kind] == 0]:
            found = _find(traffic, kind, settings, spawned[STREAMS[kind]], flow_mps)
            if isinstance(found, int):
                looked[kind] += found
                continue
            waiting.remove(kind)
            yield replace(found, looked_through=looked[kind] + found.looked_through)
        if all(second + 1 >= GIVE_UP_S[kind] for kind in waiting):
            break
        for _ in range(round(1.0 / step_s)):
            traffic.advance()
    yield from (*waiting, *hopeless)


def _find(
    traffic: LiveTraffic,
    kind: str,
    settings: SensorSettings,
    rng: np.random.Generator,
    flow_mps: float | None,
) -> EpisodeStart | int:
    """Look for an ego at the present moment; how many were looked at if there is none."""
    now, cars = traffic.frames[-1], candidates_of(traffic, kind, settings, flow_mps)
    rows = np.array(list(cars.routes), dtype=np.int64)
    order = rows[rng.permutation(len(rows))]
    for place, (row, about) in enumerate(zip(order.tolist(), cars.concerned(order, rng), strict=False)):
        if kind == FREE or about.provoked:
            ego = str(now.vehicle_id[row])
            frames = tuple(with_ego(frame, ego, step, traffic.step_s) for step, frame in enumerate(traffic.frames))
            return EpisodeStart(
                kind=kind,
                ego=ego,
                provoked=about.provoked,
                candidates=len(rows),
                looked_through=place + 1,
                frames=frames,
                route=cars.routes[row],
                seen_before=about.seen_before,
                stands=about.stands,
            )
    return len(rows)
