"""The truth source of recorded traffic, seen from one or several of its vehicles."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from harness.truth.frame import STEP_S, Frame
from harness.truth.recorded.egos import EACH, EgoStay, plan_egos
from harness.truth.recorded.formats import apart, read_traffic
from harness.truth.recorded.traffic import RecordedTraffic, assemble


def open_recorded_traffic(
    path: Path, format_name: str, net: str, ego: str, duration_s: float, start_s: float = 0.0
) -> RecordedTrafficTruth:
    """Read recorded traffic.

    Args:
        path: The file, or the folder of a format that has one.
        format_name: Name of its format, see ``harness.truth.recorded.formats``.
        net: Network that the traffic drove on; ``recording`` takes the road from the file.
        ego: Which vehicles carry the sensor, see ``harness.truth.recorded.egos.plan_egos``.
        duration_s: How much of the recording is used.
        start_s: From where on.

    Raises:
        InputError: The file is missing, broken, or contradicts itself, or there is no such vehicle.
    """

    def read() -> tuple[RecordedTraffic, tuple[EgoStay, ...]]:
        traffic = assemble(read_traffic(path, format_name, net), path, duration_s, start_s)
        return traffic, plan_egos(traffic, ego)

    traffic, egos = apart(read, path, format_name)
    return RecordedTrafficTruth(path, format_name, traffic, egos, ego)


class RecordedTrafficTruth:
    """Frames of recorded traffic, one episode an ego; the road's section is the stretch on record."""

    def __init__(
        self, path: Path, format_name: str, traffic: RecordedTraffic, egos: tuple[EgoStay, ...], asked: str
    ) -> None:
        """Take traffic and the vehicles to see it from."""
        self.road = traffic.road
        self.step_s = STEP_S
        self.expected_steps = sum(ego.steps for ego in egos)
        self.traffic = traffic
        self.egos = egos
        self._path = path
        self._format = format_name
        self._asked = asked

    def frames(self) -> Iterator[Frame]:
        """Yield the frames; time goes on from episode to episode although the recording starts over."""
        step = 0
        for episode, ego in enumerate(self.egos):
            for recorded_step in range(ego.first_step, ego.last_step + 1):
                yield self.traffic.frame(recorded_step, step, episode, ego.stay)
                step += 1

    def close(self) -> None:
        """Do nothing: everything has been read."""

    def report(self) -> str:
        """Return what was read, kept and left out, in a few lines for the user."""
        counts = self.traffic.counts
        left_out = ", ".join(f"{count} {reason}" for reason, count in counts.left_out.items()) or "none"
        names = [str(self.traffic.names[ego.stay]) for ego in self.egos]
        egos = f"{len(names)} in turn" if self._asked.startswith(EACH) else ", then ".join(names[:6])
        extent = f"in the plane, on {len(list(self.road.lines()))} lanes"
        if self.traffic.knows_ends:
            extent = f"over {self.traffic.window_m[1] - self.traffic.window_m[0]:.0f} m"
        lines = [
            f"{self._path.name} ({self._format}): {counts.vehicles_read} vehicles read, {counts.vehicles_kept} kept; "
            f"left out: {left_out}",
            f"{self.traffic.steps * STEP_S:.1f} s on record {extent}, {counts.rows_kept} "
            f"vehicle-times; duplicate rows left out: {counts.duplicates} ({counts.contradictions} contradicting); "
            f"filled in: {counts.filled}",
            f"ego: {egos} ({self.expected_steps * STEP_S:.1f} s in all)",
            *self.traffic.notes,
        ]
        return "\n".join(lines)

    def summary(self) -> dict[str, object]:
        """Return the same as a table for ``metrics.json``."""
        counts = self.traffic.counts
        return {
            "file": self._path.name,
            "format": self._format,
            "ego": self._asked,
            "egos": len(self.egos),
            "window_m": list(self.road.section_m),
            "seconds": self.traffic.steps * STEP_S,
            "vehicles_read": counts.vehicles_read,
            "vehicles_kept": counts.vehicles_kept,
            "vehicles_left_out": dict(counts.left_out),
            "duplicate_rows": counts.duplicates,
            "contradicting_rows": counts.contradictions,
            "filled_rows": counts.filled,
        }
