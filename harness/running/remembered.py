"""Traffic that is simulated once for several sensors in turn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from harness.config.model import RunConfig, TrafficConfig
from harness.running.open import open_snapshots, simulate
from harness.running.snapshots import SnapshotStream
from harness.truth.frame import Frame, TruthSource
from harness.truth.network.network import Network
from mmpf.map.road import Road


class RememberedTraffic:
    """Opens snapshots as ``open_snapshots`` does; the frames of the traffic simulated last are kept, and played again.

    Frames are frozen, and a simulation does not depend on who looks at it, so that the snapshots are the same.
    """

    def __init__(self) -> None:
        """Prepare to open snapshots; nothing is remembered yet."""
        self._key: tuple[TrafficConfig, int, float] | None = None
        self._last: _Played | None = None

    def __call__(self, config: RunConfig) -> SnapshotStream:
        """Return the snapshots that the configuration describes; see ``open_snapshots``."""
        return open_snapshots(config, simulate=self._simulate)

    def _simulate(self, network: Network, traffic: TrafficConfig, seed: int, reach_m: float) -> TruthSource:
        key = traffic, seed, reach_m
        if self._last is not None and self._key == key:
            return self._last
        self._key, self._last = None, None
        return _Noted(simulate(network, traffic, seed, reach_m), self, key)

    def remember(self, key: tuple[TrafficConfig, int, float], played: _Played) -> None:
        """Keep frames that were all yielded in place of those kept so far."""
        self._key, self._last = key, played


@dataclass
class _Played:
    """Frames that were simulated before, as a ``TruthSource``."""

    road: Road
    step_s: float
    expected_steps: int
    noted: tuple[Frame, ...]

    def frames(self) -> Iterator[Frame]:
        return iter(self.noted)

    def close(self) -> None:
        """Nothing is held."""


class _Noted:
    """A simulation whose frames are noted as they are yielded, as a ``TruthSource``."""

    def __init__(self, truth: TruthSource, memory: RememberedTraffic, key: tuple[TrafficConfig, int, float]) -> None:
        self.road, self.step_s, self.expected_steps = truth.road, truth.step_s, truth.expected_steps
        self.close = truth.close
        self._truth, self._memory, self._key = truth, memory, key

    def frames(self) -> Iterator[Frame]:
        noted = []
        for frame in self._truth.frames():
            noted.append(frame)
            yield frame
        self._memory.remember(self._key, _Played(self.road, self.step_s, self.expected_steps, tuple(noted)))
