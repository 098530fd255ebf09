"""What is known of hidden vehicles, all of them counted, and what the knowledge costs in tracks of nobody.

The mean errors of ``mae`` hold while a vehicle is followed, so they are small for a tracker that lets go of the
difficult ones. Here the vehicle-steps are the same for every tracker on the same detections, and whoever lets go pays
the cut-off.
"""

from __future__ import annotations

import numpy as np

from harness.scoring.errors import scored_rows
from harness.scoring.evidence import Evidence
from harness.scoring.quantity import Quantity
from harness.scoring.sequence import tracks_in_sight
from harness.scoring.statistics import bootstrap_ci
from harness.sensor.observation import HIDDEN
from mmpf.compute.arrays import BoolArray, FloatArray

COST, COST_N, IDENTITY_COST = "hidden.hidden_cost_m", "hidden.n", "hidden.identity_cost_m"
FALSE_HIDDEN = "hidden.false_hidden_tracks_per_scan"
QUANTITIES = (
    Quantity(
        COST, "hidden cost (10 m if lost), m",
        decimals=2, heading="hidden cost m", weight=COST_N, compared=True, curve=True, pooled="hidden_cost_m",
        ablated=True, reported=True,
    ),
    Quantity(
        FALSE_HIDDEN, "false hidden tracks a scan",
        decimals=2, heading="false hidden", compared=True, curve=True, pooled="false_hidden_tracks_per_scan",
        ablated=True, reported=True,
    ),
    Quantity(
        "hidden.followed_percent", "hidden with a track within 10 m, %", True,
        weight=COST_N, tabled=True, reported=True,
    ),
    Quantity(
        IDENTITY_COST, "hidden cost by identity, m",
        decimals=2, weight=COST_N, tabled=True, pooled="hidden_identity_cost_m", reported=True,
    ),
)  # fmt: skip


def cost_of_hidden(evidence: Evidence) -> dict[str, object]:
    """Score what is known of the vehicles that are hidden after they were seen.

    Returns:
        ``hidden_cost_m``: mean of the distance to the track that follows the vehicle (``harness.scoring.following``)
        over all vehicle-steps ``n``, the cut-off where nobody does; ``followed_percent``, the share of them that
        somebody does. ``identity_cost_m``: the same mean by the track that held the vehicle when it was last detected,
        the cut-off where it is gone or on another vehicle, or where none did. Both with their 95 % intervals over
        vehicles under ``_ci95``. ``false_hidden_tracks_per_scan``: reported tracks out of sight that follow nobody.
        nan where there is nothing to tell.
    """
    following, rows = evidence.following, evidence.rows
    hidden = following.hidden
    vehicle = rows.truth.vehicle[hidden]
    cost_m, own_m = following.distance_m[hidden], _by_identity(evidence)[hidden]
    rng, draws = evidence.new_rng(), evidence.settings.bootstrap_draws

    def mean(values: FloatArray) -> float:
        return float(values.mean()) if len(values) else np.nan

    def interval(values: FloatArray) -> list[float] | None:
        ends = bootstrap_ci(values, rng, vehicle, draws=draws)
        return None if np.isnan(ends.low) else [ends.low, ends.high]

    unseen = following.idle & ~tracks_in_sight(rows, evidence.settings)
    return {
        "hidden_cost_m": mean(cost_m),
        "hidden_cost_m_ci95": interval(cost_m),
        "followed_percent": 100.0 * mean((following.track_row[hidden] >= 0).astype(np.float64)),
        "identity_cost_m": mean(own_m),
        "identity_cost_m_ci95": interval(own_m),
        "n": len(cost_m),
        "false_hidden_tracks_per_scan": float(unseen.sum()) / len(rows.time_s) if len(rows.time_s) else np.nan,
    }


def _by_identity(evidence: Evidence) -> FloatArray:
    """Return each vehicle's distance to the track that held it, at most the cut-off, shape (n,) along the truth."""
    errors, cutoff_m = evidence.errors, evidence.settings.follow_cutoff_m
    own: BoolArray = errors.tracked & (errors.state == HIDDEN)
    distance_m = np.full(len(evidence.rows.truth), cutoff_m)
    kept = scored_rows(evidence.rows, evidence.history, evidence.settings)[own]
    distance_m[kept] = np.minimum(cutoff_m, np.hypot(errors.absolute[own, 0], errors.absolute[own, 1]))
    return distance_m
