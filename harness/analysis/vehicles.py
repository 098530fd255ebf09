"""What each vehicle contributes to the difference of two runs, and which vehicles are not independent.

A run's metric is a ratio of sums over vehicles, or a smooth function of such sums, so each vehicle's share of its
uncertainty is its influence: the derivative along that vehicle's own sums. Vehicles near each other see the same lorry
go by and swap their tracks with one another, so they are no independent samples; how close two are is told by the time
that they drive near each other.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from harness.scoring.evidence.rows import TruthRows
from harness.scoring.evidence.rules import TIME_TOLERANCE_S
from harness.scoring.evidence.sequence import select_in_sight
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.hidden_cost import crps_of_hidden
from harness.scoring.metrics.hota import hota_couples, measure_hota
from harness.scoring.metrics.in_plain_view import RANKED_S, WORST_SHARE, measure_plain_view, worst_share
from mmpf.numerics.arrays import FloatArray, IntArray

REACH_M = 100.0
"""Distance from which two vehicles have nothing to do with each other; along the road, if it has a frame of its own."""


@dataclass(frozen=True)
class ByVehicle:
    """A metric of a run, and each vehicle's part in it.

    Attributes:
        value: The metric; nan where nothing can be told.
        influence: By vehicle code, of mean 0, shape (vehicles,); 0 of vehicles that it is not over.
        counts: Whether the metric is over the vehicle, shape (vehicles,).
        others: Influence of what belongs to no vehicle, such as tracks that never met one, shape (k,).
        share: Share of the vehicles that settles the value.
    """

    value: float
    influence: FloatArray
    counts: FloatArray
    others: FloatArray
    share: float = 1.0


def closeness(truth: TruthRows, vehicles: int) -> FloatArray:
    """Return how close each two vehicles are, shape (vehicles, vehicles): 1 with itself, 0 with one never met.

    At a step it falls along the road from 1 at the same place to 0 at ``REACH_M``; over a run it is the sum over common
    steps divided by the geometric mean of both vehicles' numbers of steps, so that the matrix is positive semidefinite.
    In the plane it falls with the square of what is left to ``REACH_M``, since a straight fall is positive semidefinite
    along a line alone (Askey 1973).
    """
    in_plane = bool(truth.direction_rad.any())
    total = np.zeros((vehicles, vehicles))
    rows = np.flatnonzero(truth.in_range)
    rows = rows[np.argsort(truth.step[rows], kind="stable")]
    for at_step in np.split(rows, np.flatnonzero(np.diff(truth.step[rows])) + 1):
        lon_m, vehicle = truth.lon_m[at_step], truth.vehicle[at_step]
        away_m = np.abs(lon_m[:, None] - lon_m)
        if in_plane:
            lat_m = truth.lat_m[at_step]
            away_m = np.hypot(away_m, lat_m[:, None] - lat_m)
        left = np.maximum(0.0, 1.0 - away_m / REACH_M)
        total[np.ix_(vehicle, vehicle)] += left**2 if in_plane else left
    steps = np.sqrt(np.maximum(np.diagonal(total), 1.0))
    near = total / np.outer(steps, steps)
    np.fill_diagonal(near, 1.0)
    return np.asarray(near)


def ratio_by_vehicle(values: FloatArray, vehicle: IntArray, vehicles: int, scale: float = 1.0) -> ByVehicle:
    """Return a mean over rows as one over vehicles.

    Args:
        values: Value of each row, shape (n,).
        vehicle: Vehicle of each row, from 0, shape (n,).
        scale: What the mean is multiplied by.
    """
    counts = np.bincount(vehicle, minlength=vehicles).astype(np.float64)
    sums = scale * np.bincount(vehicle, weights=values, minlength=vehicles)
    total = counts.sum()
    if not total:
        return ByVehicle(np.nan, np.zeros(vehicles), counts, np.zeros(0))
    mean = float(sums.sum() / total)
    return ByVehicle(mean, (sums - mean * counts) / total, counts, np.zeros(0))


def hidden_cost_by_vehicle(evidence: Evidence, vehicles: int) -> ByVehicle:
    """Return the hidden cost."""
    hidden = evidence.following.hidden
    return ratio_by_vehicle(evidence.following.distance_m[hidden], evidence.rows.truth.vehicle[hidden], vehicles)


def hidden_crps_by_vehicle(evidence: Evidence, vehicles: int) -> ByVehicle:
    """Return the continuous ranked probability score of hidden vehicles."""
    hidden = evidence.following.hidden
    return ratio_by_vehicle(crps_of_hidden(evidence), evidence.rows.truth.vehicle[hidden], vehicles)


def same_identity_by_vehicle(evidence: Evidence, vehicles: int) -> ByVehicle:
    """Return the share of occlusions after which a vehicle has its old track, in percent."""
    events = evidence.events
    vehicle = evidence.rows.truth.vehicle[events.onset_row]
    return ratio_by_vehicle(events.same_id.astype(np.float64), vehicle, vehicles, 100.0)


def plain_view_by_vehicle(evidence: Evidence, vehicles: int) -> ByVehicle:
    """Return the recall in plain view, in percent."""
    counted = evidence.plain.counted
    followed = evidence.matching.track_row[counted] >= 0
    return ratio_by_vehicle(followed.astype(np.float64), evidence.rows.truth.vehicle[counted], vehicles, 100.0)


def worst_tenth_by_vehicle(evidence: Evidence, vehicles: int) -> ByVehicle:
    """Return the recall in plain view over the worst tenth of vehicles, in percent.

    It is an expected shortfall, weighted by vehicle-steps, and its influence is that of one: vehicles in the worst
    tenth move it by how far they are below the best of them, in whose place they keep another vehicle out.
    """
    part = measure_plain_view(evidence)
    ranked = part.counted_s >= RANKED_S - TIME_TOLERANCE_S
    worst = worst_share(part.counted, part.followed, ranked, WORST_SHARE)
    counts, influence = np.zeros(vehicles), np.zeros(vehicles)
    if not len(worst):
        return ByVehicle(np.nan, influence, counts, np.zeros(0))
    counted, followed = part.counted[worst], part.followed[worst]
    steps, value, best = counted.sum(), followed.sum() / counted.sum(), (followed / counted).max()
    influence[worst] = 100.0 * (followed - counted * value - counted.mean() * (best - value)) / steps
    chosen = np.flatnonzero(ranked)
    counts[chosen] = part.counted[chosen]
    influence[chosen] -= influence[chosen].mean()
    return ByVehicle(100.0 * float(value), influence, counts, np.zeros(0), WORST_SHARE)


def hota_by_vehicle(evidence: Evidence, vehicles: int) -> ByVehicle:
    """Return HOTA in sight in percent; a track counts with the vehicle that it was most often matched to."""
    sequence, truth = evidence.in_sight, evidence.rows.truth
    selected = select_in_sight(evidence.rows, evidence.history, evidence.pairs).truth
    vehicle_of = np.zeros(int(sequence.truth_identity.max(initial=-1)) + 1, dtype=np.int64)
    vehicle_of[sequence.truth_identity] = truth.vehicle[selected]
    couples = hota_couples(sequence)
    track_rows = np.bincount(sequence.track_identity)
    # One more unit for each track, of which those that never met a vehicle are kept.
    unit_of_track = vehicles + np.arange(len(track_rows))
    strongest = np.argsort(couples.matches[:, 0], kind="stable") if len(couples.truth) else couples.truth
    unit_of_track[couples.track[strongest]] = vehicle_of[couples.truth[strongest]]
    units = vehicles + len(track_rows)

    def by_unit(weights: FloatArray) -> FloatArray:
        place = vehicle_of[couples.truth]
        grouping = sparse.csr_array((np.ones(len(place)), (place, np.arange(len(place)))), shape=(units, len(place)))
        return np.asarray(grouping @ weights)

    truths = np.bincount(vehicle_of[sequence.truth_identity], minlength=units).astype(np.float64)
    tracks = np.bincount(unit_of_track, weights=track_rows, minlength=units).astype(np.float64)
    matched, associated = by_unit(couples.matches), by_unit(couples.matches * couples.association)
    value = 100.0 * measure_hota(sequence).scores().hota if truths.sum() else np.nan
    influence = 100.0 * _hota_influence(truths, tracks, matched, associated)
    return ByVehicle(value, influence[:vehicles], truths[:vehicles], influence[vehicles:][tracks[vehicles:] > 0.0])


def _hota_influence(truths: FloatArray, tracks: FloatArray, matched: FloatArray, associated: FloatArray) -> FloatArray:
    """Return the derivative of HOTA along each unit's sums, shape (units,), per threshold (units, thresholds)."""
    every, rows = matched.sum(axis=0), truths + tracks
    union = rows.sum() - every
    found = (every > 0.0) & (union > 0.0)
    if not found.any():
        return np.zeros(len(truths))
    every, union, matched, associated = every[found], union[found], matched[:, found], associated[:, found]
    hota = np.sqrt(every / union * associated.sum(axis=0) / every)
    # HOTA = sqrt(associated / union) at each threshold, of which both are sums over units.
    part = associated / associated.sum(axis=0) - (rows[:, None] - matched) / union
    return np.asarray((0.5 * hota * part).sum(axis=1) / len(found))
