"""What happens to a track while its vehicle is hidden and when it is seen again."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from harness.scoring.evidence.events import OcclusionEvents
from harness.scoring.evidence.rules import MEMORY_S, TIME_TOLERANCE_S
from harness.scoring.metrics.parts import joined, of_any, ratio
from harness.scoring.metrics.quantity import Quantity, of_kinds

EVENTS = "occlusion.events"
SHARED = ("survived", "hijacked", "lost", "same_id")
"""Outcomes of which the share of all events is told."""
SHORT_S = 3.0
"""Longest time without detection of a short event."""
QUANTITIES = (
    Quantity("occlusion.same_id_percent", "same identity, %", True, weight=EVENTS),
    Quantity("occlusion.survived", "occlusions survived, %", True, heading="survived %", weight=EVENTS, scale=100.0),
    Quantity(
        "occlusion.same_id", "same identity after occlusion, %", True,
        heading="same id %", weight=EVENTS, scale=100.0,
    ),
    Quantity("occlusion.hijacked", "hijacked in occlusion, %", weight=EVENTS, scale=100.0),
    *of_kinds(
        "occlusion", {"short": ", hidden to 3 s", "long": ", hidden 3-10 s"},
        Quantity("same_id", "same identity{}, %", True, weight="events", scale=100.0),
        Quantity("same_id_percent", "same identity{}, %", True, decimals=0, weight="events"),
    ),
)  # fmt: skip


def occlusion_outcomes(parts: Sequence[OcclusionEvents], _: np.random.Generator) -> dict[str, object]:
    """Return the counts over all events, and those of ``short`` and ``long`` ones; see ``count_outcomes``."""
    names = [field.name for field in fields(OcclusionEvents)]
    events = OcclusionEvents(**{name: joined([getattr(part, name) for part in parts]) for name in names})
    return {
        **count_outcomes(events, 0.0, MEMORY_S),
        "short": count_outcomes(events, 0.0, SHORT_S),
        "long": count_outcomes(events, SHORT_S, MEMORY_S),
    }


def count_outcomes(events: OcclusionEvents, longer_than_s: float, at_most_s: float) -> dict[str, float]:
    """Count the outcomes of the events of a range of durations.

    Returns:
        ``events``, which are ``survived`` (the track is alive and not on another vehicle), ``hijacked`` (it is on
        another one) or ``lost`` (it is gone, or there was none at the onset, which ``untracked`` counts);
        ``same_id``, the survived ones on their vehicle again; ``alive_at_return``, those alive and not on another
        vehicle at the very re-detection; shares of the events in percent; ``median_reacquire_s`` over the events that
        were re-acquired.
    """
    chosen = (events.duration_s > longer_than_s + TIME_TOLERANCE_S) & (
        events.duration_s <= at_most_s + TIME_TOLERANCE_S
    )
    total = int(chosen.sum())
    counts = {name: int((getattr(events, name) & chosen).sum()) for name in SHARED}
    return {
        "events": total,
        **counts,
        "untracked": int((chosen & (events.track_id < 0)).sum()),
        "alive_at_return": int((chosen & events.alive_at_return).sum()),
        **{f"{name}_percent": ratio(100.0 * count, total) for name, count in counts.items()},
        "median_reacquire_s": of_any(np.median, events.reacquire_s[chosen & np.isfinite(events.reacquire_s)]),
    }
