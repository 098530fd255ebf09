"""Vehicles hidden on purpose (pseudo-occlusion, Liu and Caesar 2023, arXiv 2310.01288).

The detections of a moving vehicle are withheld for a given time after it was in view. Everything else stays as it is:
the truth goes on, the vehicle hides others, and no tracker is told. Which vehicle is hidden when depends on the
traffic, the sensor and the seed, and is the same for every tracker.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from harness.config.altered import AlteredSettings
from harness.sensor.observation import Snapshot
from harness.storage.schema import HIDDEN
from mmpf.numerics.arrays import BoolArray, FloatArray

MOVING_MPS = 1.0
"""Speed above which a vehicle may be hidden."""
HIDE_AFTER_S = 2.0
"""Time in view before a vehicle may be hidden."""
LONGEST_GAP_S = 0.5
"""Longest time between two detections of a vehicle that is in view all along."""
TIME_TOLERANCE_S = 1e-6


@dataclass
class _Vehicle:
    """A vehicle as the sensor has seen it: in view since when, hidden from when and for how long."""

    since_s: float
    seen_s: float
    delay_s: float
    hidden_from_s: float = -np.inf
    hidden_for_s: float = 0.0

    def is_hidden(self, time_s: float) -> bool:
        return time_s < self.hidden_from_s + self.hidden_for_s - TIME_TOLERANCE_S


def hidden_on_purpose(
    snapshots: Iterable[Snapshot], settings: AlteredSettings, rng: np.random.Generator
) -> Iterator[Snapshot]:
    """Yield snapshots in which some vehicles are hidden for a time: they give no detection, and their state is hidden.

    A vehicle may be hidden once it moves and has been in view for two seconds and a delay, uniform up to as much
    again. How long is drawn from ``hide_s`` for each. At most ``hide_share`` of the detected vehicles are hidden at a
    time, at least one.
    """
    known: dict[str, _Vehicle] = {}
    episode = -1
    for snapshot in snapshots:
        if snapshot.frame.episode != episode:
            known, episode = {}, snapshot.frame.episode
        _note_detections(known, snapshot, rng)
        _hide(known, snapshot, settings, rng)
        yield _without_hidden(known, snapshot)


def _note_detections(known: dict[str, _Vehicle], snapshot: Snapshot, rng: np.random.Generator) -> None:
    time_s = snapshot.frame.time_s
    for name in sorted(set(snapshot.observation.truth_id.tolist()) - {""}):
        vehicle = known.get(name)
        if vehicle is None or time_s - vehicle.seen_s > LONGEST_GAP_S + TIME_TOLERANCE_S:
            hidden = (vehicle.hidden_from_s, vehicle.hidden_for_s) if vehicle else (-np.inf, 0.0)
            known[name] = vehicle = _Vehicle(time_s, time_s, HIDE_AFTER_S * rng.random(), *hidden)
        vehicle.seen_s = time_s
        if vehicle.is_hidden(time_s):
            vehicle.since_s = time_s


def _hide(known: dict[str, _Vehicle], snapshot: Snapshot, settings: AlteredSettings, rng: np.random.Generator) -> None:
    frame = snapshot.frame
    speed = dict(zip(frame.vehicle_id.tolist(), frame.speed_mps.tolist(), strict=True))
    seen = [name for name in sorted(known) if known[name].seen_s == frame.time_s]
    room = max(1.0, settings.hide_share * len(seen)) - sum(known[name].is_hidden(frame.time_s) for name in known)
    for name in rng.permutation(np.array(seen, dtype=np.str_)).tolist():
        vehicle = known[name]
        waited = frame.time_s - vehicle.since_s >= HIDE_AFTER_S + vehicle.delay_s
        if room >= 1.0 and waited and not vehicle.is_hidden(frame.time_s) and abs(speed[name]) > MOVING_MPS:
            vehicle.hidden_from_s, vehicle.hidden_for_s = frame.time_s, float(rng.choice(settings.hide_s))
            vehicle.delay_s, vehicle.since_s = HIDE_AFTER_S * rng.random(), frame.time_s
            room -= 1.0


def _without_hidden(known: dict[str, _Vehicle], snapshot: Snapshot) -> Snapshot:
    time_s, seen = snapshot.frame.time_s, snapshot.observation
    withheld = {name: vehicle.hidden_for_s for name, vehicle in known.items() if vehicle.is_hidden(time_s)}
    pseudo_hidden_s: FloatArray = np.array([withheld.get(name, 0.0) for name in snapshot.frame.vehicle_id.tolist()])
    hidden: BoolArray = pseudo_hidden_s > 0.0
    kept = np.array([name not in withheld for name in seen.truth_id.tolist()], dtype=np.bool_)
    state = np.where(hidden & seen.in_range, HIDDEN, seen.state).astype(np.int8)
    return replace(
        snapshot,
        observation=replace(
            seen.with_detections(np.flatnonzero(kept)),
            visible_fraction=np.where(hidden, 0.0, seen.visible_fraction),
            state=state,
            pseudo_hidden_s=pseudo_hidden_s,
        ),
    )
