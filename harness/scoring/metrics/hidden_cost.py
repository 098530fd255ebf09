"""The cost of hidden vehicles: errors with lost vehicles counted, and false tracks in hidden space.

The mean errors of ``mae`` hold while a vehicle is followed, so they are small for a tracker that lets go of the
difficult ones. Here the vehicle-steps are the same for every tracker on the same detections, and whoever lets go pays
the cut-off. The distance does not depend on the deviations that tracks state, but the continuous ranked probability
score does. Without the cut-off it is a proper score: least on average for the distribution of the errors (Gneiting
and Raftery 2007).
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.special import erf

from harness.common.bootstrap import group_sums
from harness.scoring.evidence.errors import scored_rows
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M
from harness.scoring.evidence.sequence import tracks_in_sight
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import ROWS, drawn_of_whole, intervals_of, ratio
from harness.scoring.metrics.quantity import STEPS, Quantity
from harness.storage.schema import HIDDEN
from mmpf.numerics.arrays import BoolArray, FloatArray

COSTS = ("hidden_cost_m", "identity_cost_m", "hidden_crps_m")
COST, IDENTITY_COST, CRPS = (f"hidden.{name}" for name in COSTS)
COST_N, FALSE_HIDDEN = "hidden.n", "hidden.false_hidden_tracks_per_scan"
SMALLEST_STD_M = 1e-9
QUANTITIES = (
    Quantity(
        COST, "hidden cost (10 m if lost), m",
        decimals=2, heading="hidden cost m", weight=COST_N, limit=FOLLOW_CUTOFF_M,
    ),
    Quantity(
        CRPS, "hidden CRPS (10 m if lost), m",
        decimals=2, heading="hidden CRPS m", weight=COST_N, limit=FOLLOW_CUTOFF_M,
    ),
    Quantity(FALSE_HIDDEN, "false hidden tracks a scan", decimals=2, heading="false hidden", weight=STEPS),
    Quantity("hidden.followed_percent", "hidden with a track within 10 m, %", True, weight=COST_N),
    Quantity(IDENTITY_COST, "hidden cost by identity, m", decimals=2, weight=COST_N, limit=FOLLOW_CUTOFF_M),
)  # fmt: skip


@dataclass(frozen=True)
class HiddenPart:
    """What is known of the ``n`` hidden vehicle-steps of a stretch, of which somebody follows ``followed``.

    ``total_m`` adds up ``COSTS`` over them, shape (3,), and ``by_vehicle_m`` over the ``steps`` of each vehicle, both
    of shape (vehicles, 3). ``false_tracks`` are reported, out of sight and follow nobody.
    """

    total_m: FloatArray
    n: int
    followed: int
    false_tracks: int
    scans: int
    by_vehicle_m: FloatArray = field(metadata=ROWS)
    steps: FloatArray = field(metadata=ROWS)


def measure_hidden(evidence: Evidence) -> HiddenPart:
    """Measure a stretch."""
    following, rows = evidence.following, evidence.rows
    hidden = following.hidden
    costs_m = [following.distance_m[hidden], _by_identity(evidence)[hidden], crps_of_hidden(evidence)]
    vehicle = np.unique(rows.truth.vehicle[hidden], return_inverse=True)[1]
    by_vehicle_m, steps = group_sums(np.column_stack(costs_m), vehicle)
    unseen = following.idle & ~tracks_in_sight(rows, new_ones=False)
    return HiddenPart(
        total_m=np.array([values.sum() for values in costs_m]),
        n=int(hidden.sum()),
        followed=int((following.track_row[hidden] >= 0).sum()),
        false_tracks=int(unseen.sum()),
        scans=len(rows.time_s),
        by_vehicle_m=by_vehicle_m,
        steps=steps,
    )


@drawn_of_whole
def cost_of_hidden(part: HiddenPart, rng: np.random.Generator) -> dict[str, object]:
    """Score the knowledge about vehicles that are hidden after they were seen.

    Returns:
        ``hidden_cost_m``: mean of the distance to the track that follows the vehicle (``following``)
        over all vehicle-steps ``n``, the cut-off where nobody does; ``followed_percent``, the share of them that
        somebody does. ``hidden_crps_m``: the same mean of the continuous ranked probability score of that track's
        position along the road, as the normal distribution that it states, at most the cut-off. That is the absolute
        error for a deviation of 0 or none; where errors are far below the cut-off, the right deviation is best. In the
        plane, the axis nearer to the vehicle's direction stands for the road. ``identity_cost_m``: mean distance
        to the track that held the vehicle when it was last detected, the cut-off where it is gone or on another
        vehicle, or where none did. All three with their 95 % intervals over vehicles under ``_ci95``.
        ``false_hidden_tracks_per_scan``: reported tracks that follow nobody and have had no detection within the gate
        for 0.5 s, or never. nan where there is nothing to tell.
    """
    intervals: dict[str, list[float] | None] = {}
    # Each has its own resamples, so that one more cost changes no interval of the others.
    for name, sums_m, steps in zip(COSTS, part.by_vehicle_m.T, part.steps.T, strict=True):
        intervals |= intervals_of((name,), sums_m[:, None], steps[:, None], rng)
    return {
        **{name: ratio(total_m, part.n) for name, total_m in zip(COSTS, part.total_m, strict=True)},
        **intervals,
        "followed_percent": 100.0 * ratio(part.followed, part.n),
        "n": part.n,
        "false_hidden_tracks_per_scan": ratio(part.false_tracks, part.scans),
    }


def crps_of_hidden(evidence: Evidence) -> FloatArray:
    """Return the continuous ranked probability score of each hidden vehicle's position along the road, metres.

    Tracks state the deviation along each axis of the frame, and no correlation. So where positions are in the plane, no
    deviation along the road is known, and the axis that is nearer to the vehicle's direction is scored.

    Returns:
        At most the cut-off, which it is where nobody follows the vehicle, shape (h,) along the hidden ones.
    """
    truth, tracks, following = evidence.rows.truth, evidence.rows.tracks, evidence.following
    hidden = np.flatnonzero(following.hidden)
    scores_m, followed = np.full(len(hidden), FOLLOW_CUTOFF_M), following.track_row[hidden] >= 0
    row, track = hidden[followed], following.track_row[hidden[followed]]
    is_y = np.abs(np.sin(truth.direction_rad[row])) > np.abs(np.cos(truth.direction_rad[row]))
    lon_m, lat_m = tracks.lon_m[track] - truth.lon_m[row], tracks.lat_m[track] - truth.lat_m[row]
    std_m = np.where(is_y, tracks.std_lat_m[track], tracks.std_lon_m[track])
    scores_m[followed] = np.minimum(FOLLOW_CUTOFF_M, gaussian_crps(np.where(is_y, lat_m, lon_m), std_m))
    return scores_m


def gaussian_crps(error_m: FloatArray, std_m: FloatArray) -> FloatArray:
    """Return the continuous ranked probability score of normal distributions (Gneiting et al. 2005), shape (n,).

    Args:
        error_m: Mean minus truth, metres, shape (n,).
        std_m: Standard deviation, metres, shape (n,); nan, where none is stated, counts as 0.

    Returns:
        Metres, shape (n,); the absolute error where the deviation is 0.
    """
    away_m, std_m = np.abs(error_m), np.where(std_m > 0.0, std_m, 0.0)
    z = away_m / np.maximum(std_m, SMALLEST_STD_M)
    density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    return np.asarray(away_m * erf(z / np.sqrt(2.0)) + std_m * (2.0 * density - 1.0 / np.sqrt(np.pi)))


def _by_identity(evidence: Evidence) -> FloatArray:
    """Return each vehicle's distance to the track that held it, at most the cut-off, shape (n,) along the truth."""
    errors = evidence.errors
    own: BoolArray = errors.tracked & (errors.state == HIDDEN)
    distance_m = np.full(len(evidence.rows.truth), FOLLOW_CUTOFF_M)
    kept = scored_rows(evidence.rows, evidence.history)[own]
    distance_m[kept] = np.minimum(FOLLOW_CUTOFF_M, np.hypot(errors.absolute[own, 0], errors.absolute[own, 1]))
    return distance_m
