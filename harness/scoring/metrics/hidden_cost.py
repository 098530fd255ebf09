"""The cost of hidden vehicles: errors with lost vehicles counted, and false tracks in hidden space.

The mean errors of ``mae`` hold while a vehicle is followed, so they are small for a tracker that lets go of the
difficult ones. Here the vehicle-steps are the same for every tracker on the same detections, and whoever lets go pays
the cut-off.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from harness.common.bootstrap import cluster_bootstrap, sums_by_label
from harness.scoring.evidence.errors import scored_rows
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M
from harness.scoring.evidence.sequence import tracks_in_sight
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import ROWS, drawn_of_whole, ratio
from harness.scoring.metrics.quantity import STEPS, Quantity
from harness.storage.schema import HIDDEN
from mmpf.numerics.arrays import BoolArray, FloatArray

COST, COST_N, IDENTITY_COST = "hidden.hidden_cost_m", "hidden.n", "hidden.identity_cost_m"
FALSE_HIDDEN = "hidden.false_hidden_tracks_per_scan"
QUANTITIES = (
    Quantity(
        COST, "hidden cost (10 m if lost), m",
        decimals=2, heading="hidden cost m", weight=COST_N, limit=FOLLOW_CUTOFF_M,
    ),
    Quantity(FALSE_HIDDEN, "false hidden tracks a scan", decimals=2, heading="false hidden", weight=STEPS),
    Quantity("hidden.followed_percent", "hidden with a track within 10 m, %", True, weight=COST_N),
    Quantity(IDENTITY_COST, "hidden cost by identity, m", decimals=2, weight=COST_N, limit=FOLLOW_CUTOFF_M),
)  # fmt: skip


@dataclass(frozen=True)
class CostSums:
    """A cost over hidden vehicle-steps: its sum, each vehicle's and their number, both of shape (vehicles, 1)."""

    total_m: float
    by_vehicle_m: FloatArray = field(metadata=ROWS)
    steps: FloatArray = field(metadata=ROWS)


@dataclass(frozen=True)
class HiddenPart:
    """What is known of the ``n`` hidden vehicle-steps of a stretch, of which somebody follows ``followed``.

    ``cost`` is by the tracks that follow them, ``own`` by those that held them; ``false_tracks`` are reported, out of
    sight and follow nobody.
    """

    cost: CostSums
    own: CostSums
    n: int
    followed: int
    false_tracks: int
    scans: int


def measure_hidden(evidence: Evidence) -> HiddenPart:
    """Measure a stretch."""
    following, rows = evidence.following, evidence.rows
    hidden = following.hidden
    vehicle = rows.truth.vehicle[hidden]

    def cost(values_m: FloatArray) -> CostSums:
        return CostSums(float(values_m.sum()), *sums_by_label(values_m, vehicle))

    unseen = following.idle & ~tracks_in_sight(rows, new_ones=False)
    return HiddenPart(
        cost=cost(following.distance_m[hidden]),
        own=cost(_by_identity(evidence)[hidden]),
        n=int(hidden.sum()),
        followed=int((following.track_row[hidden] >= 0).sum()),
        false_tracks=int(unseen.sum()),
        scans=len(rows.time_s),
    )


@drawn_of_whole
def cost_of_hidden(part: HiddenPart, rng: np.random.Generator) -> dict[str, object]:
    """Score the knowledge about vehicles that are hidden after they were seen.

    Returns:
        ``hidden_cost_m``: mean of the distance to the track that follows the vehicle (``following``)
        over all vehicle-steps ``n``, the cut-off where nobody does; ``followed_percent``, the share of them that
        somebody does. ``identity_cost_m``: the same mean by the track that held the vehicle when it was last detected,
        the cut-off where it is gone or on another vehicle, or where none did. Both with their 95 % intervals over
        vehicles under ``_ci95``. ``false_hidden_tracks_per_scan``: reported tracks that follow nobody and have had no
        detection within the gate for 0.5 s, or never. nan where there is nothing to tell.
    """

    def interval(cost: CostSums) -> list[float] | None:
        ends = cluster_bootstrap(cost.by_vehicle_m, cost.steps, rng)[0]
        return None if np.isnan(ends.low) else [ends.low, ends.high]

    return {
        "hidden_cost_m": ratio(part.cost.total_m, part.n),
        "hidden_cost_m_ci95": interval(part.cost),
        "followed_percent": 100.0 * ratio(part.followed, part.n),
        "identity_cost_m": ratio(part.own.total_m, part.n),
        "identity_cost_m_ci95": interval(part.own),
        "n": part.n,
        "false_hidden_tracks_per_scan": ratio(part.false_tracks, part.scans),
    }


def _by_identity(evidence: Evidence) -> FloatArray:
    """Return each vehicle's distance to the track that held it, at most the cut-off, shape (n,) along the truth."""
    errors = evidence.errors
    own: BoolArray = errors.tracked & (errors.state == HIDDEN)
    distance_m = np.full(len(evidence.rows.truth), FOLLOW_CUTOFF_M)
    kept = scored_rows(evidence.rows, evidence.history)[own]
    distance_m[kept] = np.minimum(FOLLOW_CUTOFF_M, np.hypot(errors.absolute[own, 0], errors.absolute[own, 1]))
    return distance_m
