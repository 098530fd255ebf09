"""Vehicles in plain view that were never reported or lost their track; they come first in the failure gallery."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.report.top_view import Subject
from harness.running.finished import RecordedRun
from harness.scoring.metrics.in_plain_view import DROPPED, NAME
from harness.storage.tables import floats

WORST = 4
AFTERWARDS_S = 0.5
TWO_WHEELER_M, LORRY_M = 3.0, 7.5
"""A vehicle up to the first length is a two-wheeler, one from the second on a lorry."""


@dataclass(frozen=True)
class Withheld:
    """A vehicle in plain view without a track, from when to when, how near the ego it came, and for how long.

    It was never reported, or dropped if it had a track before. ``detected_percent`` is the share of these scans with a
    detection of it; ``length_m`` is nan where it is not known.
    """

    vehicle_id: str
    dropped: bool
    from_s: float
    to_s: float
    closest_m: float
    without_track_s: float
    detected_percent: float
    length_m: float

    @property
    def subject(self) -> Subject:
        """What its pictures are about."""
        return Subject(self.vehicle_id, -1, with_ego=True)

    def replayed_s(self, run: RecordedRun) -> tuple[float, float]:  # noqa: ARG002
        """Return when the replay begins and stops."""
        return self.from_s, self.to_s + AFTERWARDS_S

    def sentence(self) -> str:
        """Return a sentence on what happened."""
        kind = "two-wheeler" if self.length_m <= TWO_WHEELER_M else "lorry" if self.length_m >= LORRY_M else "car"
        before = "had a track before that" if self.dropped else "never had a track"
        return (
            f"A {kind} in plain view at {self.closest_m:.0f} m had no track for {self.without_track_s:.1f} s; it was "
            f"detected in {self.detected_percent:.0f} % of scans. It is {self.vehicle_id}, and {before}."
        )

    def moments(self, run: RecordedRun) -> list[tuple[int, str]]:
        """Return the steps that are drawn, with their headings."""
        own = run.truth[run.truth["vehicle_id"].to_numpy(dtype=object) == self.vehicle_id]
        times, steps = floats(own, "time_s"), own["step"].to_numpy(dtype=np.int64)
        lasts_s = self.to_s - self.from_s
        wanted_s = self.from_s + lasts_s * np.linspace(0.0, 1.0, 5)
        chosen = [int(np.argmin(np.abs(times - time_s))) for time_s in wanted_s]
        start_s = float(times[chosen[0]])
        later = [(int(steps[at]), f"{times[at] - start_s:.1f} s later") for at in chosen[1:]]
        return [(int(steps[chosen[0]]), f"in plain view, {start_s:.1f} s"), *later]


def withheld_words(metrics: Mapping[str, Any]) -> str:
    """Return a phrase on the numbers of withheld vehicles and dropped tracks; empty without any."""
    table = metrics.get(NAME) or {}
    counts = ((table.get("never_reported") or 0, "never got a track"), (table.get("dropped") or 0, "lost it"))
    return " and ".join(f"{count} {what}" for count, what in counts if count)


def withheld_vehicles(run: RecordedRun, count: int = WORST) -> list[Withheld]:
    """Return the worst of them, worst first; none of a run that was scored before there was such a list.

    Of a long run those count alone that the read part of its tables shows.
    """
    table = run.metrics.get(NAME) or {}
    end_s = float(run.truth["time_s"].max()) if len(run.truth) else -np.inf
    names = run.truth["vehicle_id"].to_numpy(dtype=object)
    found = []
    for entry in table.get("vehicles") or []:
        own = names == entry["id"]
        if entry["to_s"] > end_s + 1e-6 or not own.any():
            continue
        found.append(
            Withheld(
                vehicle_id=entry["id"],
                dropped=entry["kind"] == DROPPED,
                from_s=entry["from_s"],
                to_s=entry["to_s"],
                closest_m=entry["closest_m"],
                without_track_s=entry["without_track_s"],
                detected_percent=entry["detected_percent"],
                length_m=float(floats(run.truth, "length_m")[own][0]),
            )
        )
    return found[:count]
