"""Compares two runs or two grids of runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.comparison.sources import SETTING, Source
from harness.comparison.verdicts import BETTER, WORSE, Arms, Verdict, compared_quantities, fewest_pairs, judge
from harness.errors import InputError
from harness.grid.cells import RECORDING
from harness.grid.rows import column_of
from harness.runfolder import folder as runfolder
from harness.scoring.paired import KEYS, QUANTITIES, paired_errors
from harness.scoring.quantity import Quantity
from harness.writing.numbers import without_nan
from mmpf.compute.arrays import FloatArray

if TYPE_CHECKING:
    import pandas as pd


ERROR_COLUMNS = {"lon_m": "lon_error_m", "lat_m": "lat_error_m", "speed_mps": "speed_error_mps"}
FOLLOWED, HIDDEN = "hidden_outcomes.tracked_percent", ("mae.hidden.lon_m", "mae.hidden.speed_mps")


@dataclass(frozen=True)
class Comparison:
    """A comparison of b with a.

    Attributes:
        a: Name of the first side.
        b: Name of the second.
        verdicts: One for each tracker and metric.
        notes: What a reader must know beside.
        tolerance: A worse value is a regression if the difference exceeds this share of a.
        wanting: What is missing beside single metrics' values, a sentence each: b may not pass without it.
    """

    a: str
    b: str
    verdicts: tuple[Verdict, ...]
    notes: tuple[str, ...]
    tolerance: float
    wanting: tuple[str, ...] = ()

    @property
    def regression(self) -> bool:
        """Whether anything is worse beyond the tolerance."""
        return any(verdict.regression for verdict in self.verdicts)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why nothing may be concluded, a sentence each; empty where something may be."""
        metrics: dict[str, list[str]] = {}
        for verdict in self.verdicts:
            if verdict.wanting:
                metrics.setdefault(f"{verdict.label}: {verdict.wanting}", []).append(verdict.metric)
        of_metrics = [
            f"{why} ({', '.join(names[:3])}{f' and {len(names) - 3} more' if len(names) > 3 else ''})."
            for why, names in metrics.items()
        ]
        untested = not any(np.isfinite(verdict.p) for verdict in self.verdicts)
        nothing = ["No metric has values on both sides that could be tested."] if untested else []
        return (*self.wanting, *of_metrics, *nothing)

    @property
    def outcome(self) -> str:
        """The verdict over all: ``regression``, ``undecided`` for want of data, or ``no regression``."""
        return "regression" if self.regression else "undecided" if self.reasons else "no regression"

    def as_table(self) -> dict[str, Any]:
        """Return everything as plain nested values."""
        told = {"regression": self.regression, "outcome": self.outcome, "reasons": self.reasons}
        table: dict[str, Any] = without_nan(asdict(self) | told)
        return table


def compare(a: Source, b: Source, tolerance: float) -> Comparison:
    """Compare b with a.

    Runs on the same traffic (same settings and seed) are paired. Without common seeds, whole arms are compared, which
    needs larger differences. Two single runs on the same traffic are paired vehicle by vehicle.

    Args:
        a: The first side, the older one perhaps.
        b: The second.
        tolerance: A worse value is a regression if the difference exceeds this share of a.

    Raises:
        InputError: They have no tracker or no setting in common, or are single runs on different traffic.
    """
    notes = [f"{side.failed} failed runs of {side.name} are left out." for side in (a, b) if side.failed]
    for side in (a, b):
        if not len(side.rows):
            raise InputError(f"compare: every run of {side.name} failed, so there is nothing to compare; run it again")
    if len(a.rows) == 1 and len(b.rows) == 1 and a.is_run and b.is_run:
        arms, note = _arms_by_vehicle(a, b), "One seed: vehicles are paired, so this tells nothing of other traffic."
        notes = [note, *_common_note(a, b), *notes]
        return Comparison(a.name, b.name, tuple(judge(arms, tolerance)), tuple(notes), tolerance)
    arms = []
    for label, rows_a, rows_b in _matching_labels(a, b):
        recorded = [RECORDING] if RECORDING in rows_a and RECORDING in rows_b else []
        arms += _arms(label, rows_a, rows_b, [*SETTING, *recorded, *a.axes])
    if not any(len(arm.a) and len(arm.b) for arm in arms):
        raise InputError(
            f"compare: {a.name} and {b.name} have no setting in common; compare grids of the same densities"
        )
    verdicts = tuple(judge(arms, tolerance))
    told = (*notes, *_power_notes(arms), *_survivor_notes(verdicts))
    return Comparison(a.name, b.name, verdicts, told, tolerance, tuple(_missing_runs(a, b)))


def _missing_runs(a: Source, b: Source) -> list[str]:
    """Return what of a has no counterpart in b that it should have: failed runs, and trackers that are gone."""
    missing = []
    if b.failed:
        missing.append(f"{b.failed} runs of b failed; mend them by --resume --retry-failed.")
    gone = [label for label in a.labels if label not in b.labels]
    if gone and any(label in b.labels for label in a.labels):
        missing.append(
            f"b has no finished run of {', '.join(gone)}; choose one tracker by FOLDER@LABEL if that is meant."
        )
    return missing


def _arms_by_vehicle(a: Source, b: Source) -> list[Arms]:
    """Return the mean absolute errors of each vehicle in both runs, over the steps at which both follow it.

    Scores of a whole run, which no vehicle has of its own, are given untested.
    """
    _check_same_traffic(a, b)
    columns = (*KEYS, *QUANTITIES, "state", "seconds_hidden", "outcome")
    first, second = (runfolder.read_table(side.folder, runfolder.ERRORS, "compare", columns) for side in (a, b))
    pairs = paired_errors(first, second)
    label = a.labels[0] if a.labels == b.labels else f"{a.labels[0]} to {b.labels[0]}"
    return [_arm(label, each, pairs, a, b) for each in compared_quantities()]


def _common_note(a: Source, b: Source) -> list[str]:
    """Tell what share of the hidden vehicle-steps each run follows; errors are over those that both do."""
    shares = [float(column_of(side.rows, FOLLOWED)[0]) for side in (a, b)]
    if not np.isfinite(shares).all():
        return []
    return [
        "Errors of hidden vehicles are over the vehicle-steps that both follow; of all of them a follows "
        f"{shares[0]:.0f} %, b {shares[1]:.0f} %."
    ]


def _check_same_traffic(a: Source, b: Source) -> None:
    places = ["step", "vehicle_id", "lon_m", "lat_m"]
    first, second = (runfolder.read_table(side.folder, runfolder.TRUTH, "compare", places)[places] for side in (a, b))
    if not first.equals(second):
        raise InputError(
            f"compare: {a.name} and {b.name} are single runs on different traffic, which tells nothing; make the "
            f"second with `replay` {a.folder}, or compare grids of several seeds"
        )


def _arm(label: str, quantity: Quantity, pairs: pd.DataFrame, a: Source, b: Source) -> Arms:
    table, state, *name = quantity.key.split(".")
    if table != "mae" or name[0] not in ERROR_COLUMNS:
        of_a, of_b = (column_of(side.rows, quantity.key) for side in (a, b))
        return Arms(label, quantity, of_a, of_b, testable=False)
    rows = pairs[pairs["state"] == state]
    vehicle = [rows["episode"], rows["vehicle_id"]]
    of_a, of_b = (_vehicle_means(rows[f"{ERROR_COLUMNS[name[0]]}_{side}"], vehicle) for side in ("a", "b"))
    return Arms(label, quantity, of_a, of_b)


def _vehicle_means(errors: pd.Series[float], vehicle: list[pd.Series[str]]) -> FloatArray:
    return np.asarray(errors.abs().groupby(vehicle).mean(), dtype=np.float64)


def _matching_labels(a: Source, b: Source) -> Iterator[tuple[str, pd.DataFrame, pd.DataFrame]]:
    if a.axes != b.axes:
        raise InputError(f"compare: {a.name} and {b.name} vary different settings; compare grids of the same settings")
    for side in (a, b):
        if missing := [axis for axis in side.axes if axis not in side.rows]:
            raise InputError(f"compare: {side.name} lacks the columns {', '.join(missing)}; make the grid again")
    common = [label for label in a.labels if label in b.labels]
    if not common and len(a.labels) == len(b.labels) == 1:
        yield f"{a.labels[0]} to {b.labels[0]}", a.rows, b.rows
    elif not common:
        raise InputError(
            f"compare: {a.name} and {b.name} have no tracker in common; choose one of each by FOLDER@LABEL, for "
            f"example '{a.folder}@{a.labels[0]}' '{b.folder}@{b.labels[0]}'"
        )
    for label in common:
        yield label, a.rows[a.rows["label"] == label], b.rows[b.rows["label"] == label]


def _arms(label: str, a: pd.DataFrame, b: pd.DataFrame, settings: list[str]) -> list[Arms]:
    import pandas as pd  # noqa: PLC0415

    both = pd.concat([a[settings], b[settings]], ignore_index=True).astype(object)
    stratum = both.where(both.notna(), "").apply(tuple, axis=1).factorize()[0].astype(np.int64)
    stratum_a, stratum_b = stratum[: len(a)], stratum[len(a) :]
    keys_a = {key: place for place, key in enumerate(zip(stratum_a.tolist(), a["seed"], strict=True))}
    keys_b = {key: place for place, key in enumerate(zip(stratum_b.tolist(), b["seed"], strict=True))}
    common = [key for key in keys_a if key in keys_b]
    of_a, of_b = (np.array([keys[key] for key in common], dtype=np.int64) for keys in (keys_a, keys_b))
    strata = None
    if not common:
        of_a, of_b = (np.flatnonzero(np.isin(*pair)) for pair in ((stratum_a, stratum_b), (stratum_b, stratum_a)))
        strata = stratum_a[of_a], stratum_b[of_b]
    return [
        Arms(label, quantity, column_of(a, quantity.key)[of_a], column_of(b, quantity.key)[of_b], strata)
        for quantity in compared_quantities()
    ]


def _power_notes(arms: list[Arms]) -> list[str]:
    notes = []
    paired = all(arm.strata is None for arm in arms)
    if not paired:
        notes.append("No seeds in common: whole arms are compared, which shows only larger differences than pairs do.")
    pairs = min(len(arm.a) for arm in arms)
    needed = fewest_pairs(len(arms))
    if paired and pairs < needed:
        notes.append(
            f"{pairs} pairs are too few for any verdict on {len(arms)} metrics: {needed} are needed; add seeds."
        )
    return notes


def _survivor_notes(verdicts: tuple[Verdict, ...]) -> list[str]:
    """Warn where the errors of hidden vehicles are over those that a tracker did not let go of."""
    lost = {verdict.label for verdict in verdicts if verdict.metric == FOLLOWED and verdict.verdict == WORSE}
    flattered = {verdict.label for verdict in verdicts if verdict.metric in HIDDEN and verdict.verdict == BETTER}
    return [
        f"{label}: errors of hidden vehicles are over those still followed; b follows fewer, so its smaller errors are "
        "no gain."
        for label in sorted(lost & flattered)
    ]
