"""Mean absolute errors by visibility and by time hidden, with intervals over vehicles.

The error of a hidden vehicle counts only while its track is alive and its own, so a tracker that soon lets go of hidden
vehicles has small errors over few rows: read it beside the share that is followed, compare trackers on the rows that
both follow (``harness.scoring.metrics.paired``), or take ``harness.scoring.metrics.hidden_cost``.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from harness.common.bootstrap import group_sums
from harness.scoring.evidence.rules import TIME_TOLERANCE_S
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.hidden_outcomes import count_outcomes, hidden_outcomes
from harness.scoring.metrics.parts import ROWS, drawn_of_whole, intervals_of, ratio
from harness.scoring.metrics.quantity import Quantity
from harness.storage.schema import HIDDEN, PARTIAL, VISIBLE
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

STATES = {"all": (VISIBLE, PARTIAL, HIDDEN), "visible": (VISIBLE,), "partial": (PARTIAL,), "hidden": (HIDDEN,)}
NAMES = ("lon_m", "lat_m", "speed_mps", "lat_speed_mps", "position_m")
HIDDEN_BINS_S = (0.0, 1.0, 2.0, 3.0, 5.0, 10.0)
"""Edges of the bins of the time since the last detection."""
VISIBLE_LON, VISIBLE_N, HIDDEN_LON, HIDDEN_N = "mae.visible.lon_m", "mae.visible.n", "mae.hidden.lon_m", "mae.hidden.n"
TWO_TO_THREE_S = "mae.by_seconds_hidden.2"
QUANTITIES = (
    Quantity(VISIBLE_LON, "MAE visible (while followed), m", decimals=2, heading="MAE seen m", weight=VISIBLE_N),
    Quantity(VISIBLE_N, "visible and followed, %", True, weight="mae.visible.of_n", scale=100.0),
    Quantity("mae.visible.speed_mps", "speed MAE visible, m/s", decimals=2, weight="mae.visible.speed_n"),
    Quantity("mae.partial.lon_m", "MAE partly hidden, m", decimals=2, weight="mae.partial.n"),
    Quantity(
        HIDDEN_LON, "longitudinal error, hidden (while followed), m",
        decimals=2, heading="MAE hidden m", weight=HIDDEN_N,
    ),
    Quantity(HIDDEN_N, "hidden and followed, %", True, heading="followed %", weight="mae.hidden.of_n", scale=100.0),
    Quantity("mae.hidden.followed_percent", "hidden and followed, %", True, weight="mae.hidden.of_n"),
    Quantity(
        f"{TWO_TO_THREE_S}.lon_m", "MAE hidden 2-3 s (while followed), m",
        decimals=2, weight=f"{TWO_TO_THREE_S}.n",
    ),
    Quantity(
        f"{TWO_TO_THREE_S}.tracked_percent", "hidden 2-3 s and followed, %", True,
        weight=f"{TWO_TO_THREE_S}.hidden_n",
    ),
    Quantity("mae.hidden.speed_mps", "speed MAE hidden, m/s", decimals=2, weight="mae.hidden.speed_n"),
)  # fmt: skip


@dataclass(frozen=True)
class ErrorSums:
    """Absolute errors of a group of vehicle-steps in a stretch.

    Attributes:
        sums: Sum of each vehicle's errors along ``NAMES``, shape (vehicles, 5).
        counts: Number of values behind each, same shape.
        followed: Vehicle-steps that were followed; only they have errors.
        outcomes: Number of vehicle-steps of each outcome, shape (outcomes,).
    """

    followed: int
    outcomes: IntArray
    sums: FloatArray = field(metadata=ROWS)
    counts: FloatArray = field(metadata=ROWS)


@dataclass(frozen=True)
class ErrorPart:
    """The errors of a stretch by visibility and by time hidden, in the order of ``STATES`` and of the bins."""

    by_state: tuple[ErrorSums, ...]
    by_bin: tuple[ErrorSums, ...]


def measure_errors(evidence: Evidence) -> ErrorPart:
    """Sum the errors of a stretch."""
    errors = evidence.errors

    def sums_of(chosen: BoolArray) -> ErrorSums:
        kept = chosen & errors.tracked
        values = np.column_stack((errors.absolute[kept], np.hypot(errors.absolute[kept, 0], errors.absolute[kept, 1])))
        of_vehicles = group_sums(values, np.unique(errors.vehicle[kept], return_inverse=True)[1])
        return ErrorSums(int(kept.sum()), count_outcomes(errors.outcome[chosen]), *of_vehicles)

    def hidden_for(from_s: float, to_s: float) -> BoolArray:
        longer = errors.seconds_hidden > from_s + TIME_TOLERANCE_S
        return longer & (errors.seconds_hidden <= to_s + TIME_TOLERANCE_S)

    return ErrorPart(
        by_state=tuple(sums_of(np.isin(errors.state, codes)) for codes in STATES.values()),
        by_bin=tuple(sums_of(hidden_for(*ends)) for ends in pairwise(HIDDEN_BINS_S)),
    )


@drawn_of_whole
def mean_errors_by_visibility(part: ErrorPart, rng: np.random.Generator) -> dict[str, object]:
    """Return the mean errors of tracked vehicles by visibility state, and of hidden ones by time since detection.

    Returns:
        ``visible``, ``partial``, ``hidden`` and ``all`` three together: mean errors, nan without rows, and the ends of
        their 95 % bootstrap intervals over vehicles under ``_ci95``, with the number of vehicle-steps of which ``n``
        were followed (``speed_n`` by tracks that state a speed), ``of_n``, and their share ``followed_percent``;
        ``position_m`` is the mean Euclidean error of the position. ``by_seconds_hidden``: one such table for each bin
        of vehicles last detected more than ``from_s`` and at most ``to_s`` ago, with their ``hidden_outcomes``.
    """
    table: dict[str, object] = {}
    for name, group in zip(STATES, part.by_state, strict=True):
        of_n = int(group.outcomes.sum())
        table[name] = _means(group, rng) | {"of_n": of_n, "followed_percent": 100.0 * ratio(group.followed, of_n)}
    bins: list[dict[str, object]] = []
    for (from_s, to_s), group in zip(pairwise(HIDDEN_BINS_S), part.by_bin, strict=True):
        outcomes = hidden_outcomes(group.outcomes)
        bins.append({"from_s": from_s, "to_s": to_s, **_means(group, rng), "hidden_n": outcomes.pop("n"), **outcomes})
    table["by_seconds_hidden"] = bins
    return table


def _means(group: ErrorSums, rng: np.random.Generator) -> dict[str, object]:
    """Return the table of means of a group; the ends are None with fewer than two vehicles."""
    total = group.counts.sum(axis=0)
    means = np.divide(group.sums.sum(axis=0), total, out=np.full(len(NAMES), np.nan), where=total > 0)
    return {
        **dict(zip(NAMES, means.tolist(), strict=True)),
        "n": group.followed,
        "speed_n": int(total[NAMES.index("speed_mps")]),
        **intervals_of(NAMES, group.sums, group.counts, rng),
    }
