"""Compares two single runs on the same traffic, vehicle by vehicle."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from harness.analysis.arms import TOLERATED_LOSS, lost_values
from harness.analysis.rules import Rules, compared_quantities
from harness.analysis.sources import Source
from harness.analysis.vehicles import (
    ByVehicle,
    closeness,
    hidden_cost_by_vehicle,
    hidden_crps_by_vehicle,
    hota_by_vehicle,
    plain_view_by_vehicle,
    ratio_by_vehicle,
    same_identity_by_vehicle,
    worst_tenth_by_vehicle,
)
from harness.analysis.verdicts import MetricDifference
from harness.analysis.why import Why, failures
from harness.common.effects import NOTHING, Effect, neighbours_effect
from harness.common.errors import InputError
from harness.scoring.evidence.errors import scored_rows
from harness.scoring.gathered import Evidence, gather
from harness.scoring.metrics.hidden_cost import COST, CRPS
from harness.scoring.metrics.in_plain_view import RECALL, WORST_TENTH
from harness.scoring.metrics.paired import KEYS, paired_errors
from harness.scoring.metrics.quantity import Quantity
from harness.storage import run_folder as runfolder
from harness.storage.checks import sound_tables
from harness.storage.grid_folder import column_of
from mmpf.numerics.arrays import FloatArray

COMPARE = "compare"
Seen = dict[str, pd.DataFrame]
"""A run's tables of truth and detections, by file."""
ERROR_COLUMNS = {"lon_m": "lon_error_m", "lat_m": "lat_error_m", "speed_mps": "speed_error_mps"}
FOLLOWED = "hidden_outcomes.tracked_percent"
BY_VEHICLE: dict[str, Callable[[Evidence, int], ByVehicle]] = {
    "mot.hota": hota_by_vehicle,
    COST: hidden_cost_by_vehicle,
    CRPS: hidden_crps_by_vehicle,
    "occlusion.same_id_percent": same_identity_by_vehicle,
    RECALL: plain_view_by_vehicle,
    WORST_TENTH: worst_tenth_by_vehicle,
}


def compare_runs(
    a: Source, b: Source, evidence: Sequence[Evidence], rules: Rules
) -> tuple[list[MetricDifference], Why]:
    """Return the differences of two single runs, given ``evidence_of`` each, and what their failures come from.

    Mean absolute errors are over the steps at which both follow a vehicle. Scores of a whole run that no vehicle has of
    its own have no interval.
    """
    first, second = evidence
    truth = first.rows.truth
    vehicles = int(truth.vehicle.max(initial=-1)) + 1
    near = closeness(truth, vehicles)
    codes = truth.vehicle[scored_rows(first.rows, first.history)]
    known = first.error_table[list(KEYS)].assign(vehicle=codes)
    pairs = paired_errors(first.error_table, second.error_table).merge(known, on=list(KEYS))
    label = label_of(a, b)

    def measured(quantity: Quantity) -> MetricDifference:
        whole = [column_of(side.rows, quantity.key) for side in (a, b)]
        of_a, of_b = (float(values[0]) for values in whole)
        there, tolerated = np.isfinite(whole), 0.0 if rules.judges(quantity) else TOLERATED_LOSS
        if wanting := lost_values(there[0], there[1], True, tolerated):
            return MetricDifference(label, quantity, of_a, of_b, NOTHING, 0, False, wanting)
        if quantity.key in BY_VEHICLE:
            sides = [BY_VEHICLE[quantity.key](evidence, vehicles) for evidence in (first, second)]
            return _of_sides(label, quantity, sides, near)
        table, state, *name = quantity.key.split(".")
        if table == "mae" and name[0] in ERROR_COLUMNS:
            return _of_sides(label, quantity, _errors(pairs, state, ERROR_COLUMNS[name[0]], vehicles), near)
        effect = Effect(of_b - of_a, np.nan, 1.0)
        return MetricDifference(label, quantity, of_a, of_b, effect, int(there.all()), of_b == of_a)

    why = Why(tuple(failures(first)), tuple(failures(second)), str(a.folder), str(b.folder))
    return [measured(quantity) for quantity in compared_quantities(rules.primary)], why


def read_seen(a: Source, b: Source) -> tuple[Seen, Seen]:
    """Return the truth and the detections of two runs on the same traffic.

    Raises:
        InputError: They are on different traffic, or a table is missing or broken.
    """
    names = (runfolder.TRUTH, runfolder.DETECTIONS)
    first, second = ({name: runfolder.read_table(side.folder, name, COMPARE) for name in names} for side in (a, b))
    places = ["step", "episode", "vehicle_id", "lon_m", "lat_m"]
    if not first[runfolder.TRUTH][places].equals(second[runfolder.TRUTH][places]):
        raise InputError(
            f"compare: {a.name} and {b.name} are single runs on different traffic, which cannot be compared; make the "
            f"second with `replay` {a.folder}, or compare grids of several seeds"
        )
    return first, second


def seen_differently(a: Seen, b: Seen) -> list[str]:
    """Return the columns of the truth and the detections of two runs on the same traffic that differ all the same."""
    both = [(name, key) for name in a for key in a[name] if key in b[name]]
    return [f"{name}'s {key}" for name, key in both if not a[name][key].equals(b[name][key])]


def label_of(a: Source, b: Source) -> str:
    """Return the tracker that is compared, or both with their sides where they differ."""
    return a.labels[0] if a.labels == b.labels else f"{a.labels[0]} (a), {b.labels[0]} (b)"


def evidence_of(folder: Path, seen: Seen) -> Evidence:
    """Return what scoring finds out about a run, from its truth and detections and from the tracks in its folder."""
    with sound_tables(folder, COMPARE):
        tracks = runfolder.read_table(folder, runfolder.TRACKS, COMPARE)
        return gather(seen[runfolder.TRUTH], seen[runfolder.DETECTIONS], tracks, 0)


PAIRED = (
    "One seed: the pairs are vehicles (1 pair: a score of the whole run), so the result holds for this traffic only. "
    "Vehicles within 100 m of each other are not independent, which widens the intervals."
)


def notes_of(a: Source, b: Source) -> list[str]:
    """Return the notes that a reader of such a comparison needs below its table."""
    shares = [float(column_of(side.rows, FOLLOWED)[0]) for side in (a, b)]
    told = "Errors of hidden vehicles are means over the vehicle-steps that both sides follow. Of all, a follows "
    return [f"{told}{shares[0]:.0f} % and b {shares[1]:.0f} %."] if np.isfinite(shares).all() else []


def _of_sides(label: str, quantity: Quantity, sides: list[ByVehicle], near: FloatArray) -> MetricDifference:
    a, b = sides
    counted = (a.counts > 0.0) | (b.counts > 0.0)
    difference = b.value - a.value
    influence = (b.influence - a.influence)[counted]
    others = np.concatenate([b.others, -a.others])
    effect = neighbours_effect(difference, influence, near[np.ix_(counted, counted)])
    variance = effect.se**2 + float(others @ others)
    same = difference == 0.0 and not influence.any() and np.array_equal(a.others, b.others)
    return MetricDifference(
        label=label,
        quantity=quantity,
        a=a.value,
        b=b.value,
        effect=Effect(difference, 0.0 if same else float(np.sqrt(variance)), effect.units, a.share),
        pairs=int(counted.sum()),
        same=same,
    )


def _errors(pairs: pd.DataFrame, state: str, column: str, vehicles: int) -> list[ByVehicle]:
    rows = pairs[pairs["state"] == state].dropna(subset=[f"{column}_{side}" for side in ("a", "b")])
    vehicle = rows["vehicle"].to_numpy(dtype=np.int64)
    errors = (rows[f"{column}_{side}"].abs().to_numpy(dtype=np.float64) for side in ("a", "b"))
    return [ratio_by_vehicle(each, vehicle, vehicles) for each in errors]
