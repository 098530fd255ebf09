"""Traffic that is simulated once for several sensors in turn."""

from __future__ import annotations

from collections.abc import Iterator

from harness.config.model import RunConfig, TrafficConfig
from harness.running.open import open_snapshots, simulate
from harness.running.snapshots import SnapshotStream
from harness.truth.frame import Frame, TruthSource
from harness.truth.network.network import Network


class RememberedTraffic:
    """Opens snapshots as ``open_snapshots`` does; the frames of the traffic simulated last are kept, and played again.

    Frames are frozen, and a simulation does not depend on who looks at it, so that the snapshots are the same.
    """

    def __init__(self) -> None:
        """Prepare to open snapshots; nothing is remembered yet."""
        self._key: tuple[TrafficConfig, int, float] | None = None
        self._last: _Noted | None = None

    def __call__(self, config: RunConfig) -> SnapshotStream:
        """Return the snapshots that the configuration describes; see ``open_snapshots``."""
        return open_snapshots(config, simulate=self._simulate)

    def _simulate(self, network: Network, traffic: TrafficConfig, seed: int, reach_m: float) -> TruthSource:
        key = traffic, seed, reach_m
        if self._last is None or self._key != key or not self._last.is_whole:
            self._last = None
            self._key, self._last = key, _Noted(simulate(network, traffic, seed, reach_m))
        return self._last


class _Noted:
    """A simulation whose frames are noted as they are yielded, and played again once all were."""

    def __init__(self, truth: TruthSource) -> None:
        self.road, self.step_s, self.expected_steps = truth.road, truth.step_s, truth.expected_steps
        self.close, self.is_whole = truth.close, False
        self._truth, self._frames = truth, list[Frame]()

    def frames(self) -> Iterator[Frame]:
        if self.is_whole:
            yield from self._frames
            return
        for frame in self._truth.frames():
            self._frames.append(frame)
            yield frame
        self.is_whole = True
