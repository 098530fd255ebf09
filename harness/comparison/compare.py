"""Compares two runs or two grids of runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.comparison.sources import SETTING, Source
from harness.comparison.vehicles import arms_by_vehicle
from harness.comparison.verdicts import BETTER, WORSE, Arms, Verdict, compared_quantities, fewest_pairs, judge
from harness.errors import InputError
from harness.grid.rows import column_of
from harness.writing.numbers import without_nan

if TYPE_CHECKING:
    import pandas as pd


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
    """

    a: str
    b: str
    verdicts: tuple[Verdict, ...]
    notes: tuple[str, ...]
    tolerance: float

    @property
    def regression(self) -> bool:
        """Whether anything is worse beyond the tolerance."""
        return any(verdict.regression for verdict in self.verdicts)

    def as_table(self) -> dict[str, Any]:
        """Return everything as plain nested values."""
        table: dict[str, Any] = without_nan(asdict(self) | {"regression": self.regression})
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
    if len(a.rows) == 1 and len(b.rows) == 1 and a.is_run and b.is_run:
        arms, note = arms_by_vehicle(a, b), "One seed: vehicles are paired, so this tells nothing of other traffic."
        return Comparison(a.name, b.name, tuple(judge(arms, tolerance)), (note, *notes), tolerance)
    arms = []
    for label, rows_a, rows_b in _matching_labels(a, b):
        arms += _arms(label, rows_a, rows_b, [*SETTING, *a.axes])
    if not any(len(arm.a) and len(arm.b) for arm in arms):
        raise InputError(
            f"compare: {a.name} and {b.name} have no setting in common; compare grids of the same densities"
        )
    verdicts = tuple(judge(arms, tolerance))
    return Comparison(a.name, b.name, verdicts, (*notes, *_power_notes(arms), *_survivor_notes(verdicts)), tolerance)


def _matching_labels(a: Source, b: Source) -> Iterator[tuple[str, pd.DataFrame, pd.DataFrame]]:
    if a.axes != b.axes:
        raise InputError(f"compare: {a.name} and {b.name} vary different settings; compare grids of the same settings")
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
    if common:
        of_a, of_b = [keys_a[key] for key in common], [keys_b[key] for key in common]
        return [
            Arms(label, quantity, column_of(a, quantity.key)[of_a], column_of(b, quantity.key)[of_b])
            for quantity in compared_quantities()
        ]
    kept_a, kept_b = np.isin(stratum_a, stratum_b), np.isin(stratum_b, stratum_a)
    return [
        Arms(
            label,
            quantity,
            column_of(a, quantity.key)[kept_a],
            column_of(b, quantity.key)[kept_b],
            False,
            stratum_a[kept_a],
            stratum_b[kept_b],
        )
        for quantity in compared_quantities()
    ]


def _power_notes(arms: list[Arms]) -> list[str]:
    notes = []
    if any(not arm.paired for arm in arms):
        notes.append("No seeds in common: whole arms are compared, which shows only larger differences than pairs do.")
    pairs = min(len(arm.a) for arm in arms)
    needed = fewest_pairs(len(arms))
    if all(arm.paired for arm in arms) and pairs < needed:
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
