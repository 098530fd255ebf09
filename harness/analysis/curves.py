"""Each tracker's curves over every varied setting, with intervals over seeds, and where each tracker fails."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy import special

from harness.analysis import coasting_ratio
from harness.common.effects import LEVEL
from harness.common.intervals import NONNEGATIVE, Possible, possible_ci
from harness.scoring.metrics.quantity import Quantity
from harness.scoring.metrics.registry import view
from harness.storage.grid_folder import column_of
from harness.storage.schema import MODEL_FILE, NET
from mmpf.numerics.arrays import FloatArray

Ratio = tuple[float | None, tuple[float, float] | None]
"""A ratio, None without a sample, and its 95 % interval, None without a scatter."""
BREAK_PERCENT, STEPS = 50.0, 1000
BREAK_METRIC = "occlusion.same_id"
FEWEST_EVENTS = 20
"""With fewer occlusions at a density, over all seeds, their share says nothing."""


# The headline of hidden vehicles first, then errors, then identities.
CURVES = (
    *("hidden.hidden_cost_m", "hidden.hidden_crps_m", "hidden.false_hidden_tracks_per_scan"),
    *("mae.visible.lon_m", "mae.hidden.lon_m", "mae.hidden.n"),
    *("occlusion.same_id", "mot.hota", "mot.id_switches", "in_plain_view.recall", "in_plain_view.worst_tenth"),
)
TABLED = (
    *("hidden", "gospa_remembered", "mae.visible.lon_m", "mae.visible.n", "mae.hidden.lon_m", "mae.hidden.n"),
    *("mae.by_seconds_hidden", "occlusion.survived", "occlusion.same_id", "occlusion.hijacked"),
    *("occlusion.short.same_id", "occlusion.long.same_id", "mot.hota", "mot.id_switches", "gospa", "in_plain_view"),
    *("calibration", "existence_calibration", "manoeuvre", "decisions", "hidden_by", "unseen_turns"),
    *("pseudo_occlusion", "never_seen.log_skill_percent"),
)
IN_WORDS: dict[str, dict[str, Any]] = {
    "mae.hidden.lon_m": {"label": "MAE hidden (while followed), m"},
    "mot.id_switches": {"label": "identity switches a run", "decimals": 1, "weight": "", "scale": None},
}
STEP_TIME = Quantity("timing.tracker_ms.p50", "time of a step, ms", heading="ms a step")


def curve_quantities() -> list[Quantity]:
    """Return what has curves, the time of a step last."""
    return [*view(CURVES, IN_WORDS), STEP_TIME]


def table_quantities() -> list[Quantity]:
    """Return what is tabulated with intervals: all that has curves, in the same order, and more."""
    return [*view(TABLED, IN_WORDS), *coasting_ratio.QUANTITIES, STEP_TIME]


@dataclass(frozen=True)
class Point:
    """One point of a curve.

    Attributes:
        label: Tracker with its settings and model; along any axis but that of several networks, its network too.
        axis: What the curve runs over.
        value: Where on that axis, a number, or the name of a demand or network.
        mean: Mean over seeds; None without a sample. Errors are pooled by their samples, shares by their events.
        ci95: Interval over seeds, of values that it can have; None where nothing is known of the scatter.
        seeds: Number of seeds with a sample.
        n: Samples or events behind it; of a ratio, what it is a ratio of, summed.
    """

    label: str
    axis: str
    value: float | str
    metric: str
    mean: float | None
    ci95: tuple[float, float] | None
    seeds: int
    n: int


@dataclass(frozen=True)
class Break:
    """The density at which a tracker breaks; None if it holds over the whole grid or nothing was occluded.

    A tracker breaks where, with growing density, the share of occlusions after which a vehicle has its old identity
    again first falls below 50 %, pooled over seeds and interpolated between the densities of the grid.

    Attributes:
        label: Tracker with its settings and model, and its network if there are several.
        ci95: Where the ends of the share's Student interval over seeds fall below it; None for an end that does not.
        held_to: Highest density of the grid with enough occlusions to tell; None if there is none.
        at_lowest: Whether it is broken at the lowest such density already, so that it may break below.
    """

    label: str
    density: float | None
    ci95: tuple[float | None, float | None] | None
    held_to: float | None
    at_lowest: bool


def _label_of(row: pd.Series) -> str:
    """Return what a run is called in tables and figures: the tracker as it was written, and its model."""
    model = row["model"]
    told = [model] if isinstance(model, str) and "model=" not in row["variant"] else []
    file = row.get(MODEL_FILE)
    return " ".join([str(row["variant"]), *told, *([file] if isinstance(file, str) else [])])


def labelled(table: pd.DataFrame) -> pd.DataFrame:
    """Return the runs that succeeded, with a column ``label``."""
    done = table[table["succeeded"].astype(bool)].copy()
    done["label"] = [_label_of(row) for _, row in done.iterrows()]
    return done


def by_network(done: pd.DataFrame) -> pd.DataFrame:
    """Return labelled runs with the network in each label, where there are several networks."""
    if not _several(done):
        return done
    return done.assign(label=[f"{label}, {net}" for label, net in zip(done["label"], done[NET], strict=True)])


def _several(table: pd.DataFrame) -> bool:
    return NET in table and len(set(table[NET])) > 1


def _axes_of(table: pd.DataFrame, varied: Sequence[str]) -> list[str]:
    """Return the axes that have curves: networks, density or demand, and varied keys, each with at least two values.

    Networks have demands of their own: only where one of them is driven at several is that an axis.
    """
    nets = [NET] if _several(table) else []
    own = [axis for axis in varied if _values(table, axis) > 1]
    traffic = [axis for axis in ("density", "demand") if _values(table, axis) > 1]
    if not nets and not traffic and not own:
        traffic = [axis for axis in ("density", "demand") if table[axis].notna().any()] or [NET]
    return [*nets, *traffic, *own]


def _values(table: pd.DataFrame, axis: str) -> int:
    """Return over how many values an axis goes, on one network."""
    networks = [runs for _, runs in table.groupby(NET)] if _several(table) else [table]
    return max((len(set(runs[axis].dropna())) for runs in networks), default=0)


def curve_points(table: pd.DataFrame, varied: Sequence[str]) -> list[Point]:
    """Return all curves' points of the rows of ``runs.parquet``, with axes beside network, density and demand."""
    done = labelled(table)
    told = [
        each for each in table_quantities() if not each.is_of_some_runs or np.isfinite(column_of(done, each.key)).any()
    ]
    points = []
    for axis in _axes_of(done, varied) if len(done) else []:
        for (label, value), runs in runs_at(done, axis):
            for quantity in told:
                sums, counts = summed_by("seed", runs, *sums_and_weights(runs, quantity))
                mean, ci95 = ratio_of(sums, counts, quantity.possible)
                seeds, n = int(np.count_nonzero(counts)), round(float(counts.sum()))
                points.append(Point(label, axis, value, quantity.key, mean, ci95, seeds, n))
    return points


def runs_at(done: pd.DataFrame, axis: str) -> Iterator[tuple[tuple[str, float | str], pd.DataFrame]]:
    """Yield the runs of each label at each place of an axis, as they stand behind its points."""
    for (label, value), runs in (done if axis == NET else by_network(done)).groupby(["label", axis], sort=False):
        yield (str(label), value if isinstance(value, str) else float(str(value))), runs


def breaks(table: pd.DataFrame) -> list[Break]:
    """Return where each tracker breaks; none without at least two densities."""
    done = by_network(labelled(table))
    if _values(done, "density") < 2:
        return []
    return [_break(str(label), runs) for label, runs in done.groupby("label", sort=False)]


def ratio_of(sums: FloatArray, counts: FloatArray, possible: Possible = NONNEGATIVE) -> Ratio:
    """Return the ratio of the totals, None without a sample, and its interval over independent units, shape (n,)."""
    total, interval = float(counts.sum()), possible_ci(sums, counts, possible)
    ends = (interval.low, interval.high) if np.isfinite(interval.low) else None
    return float(sums.sum()) / total if total > 0.0 else None, ends


def sums_and_weights(runs: pd.DataFrame, quantity: Quantity) -> tuple[FloatArray, FloatArray]:
    """Return each run's sum of a quantity and its number of samples, both of shape (runs,); nan without a value."""
    if quantity.pooled is not None:
        return quantity.pooled(partial(column_of, runs))
    values = column_of(runs, quantity.key)
    weight = column_of(runs, quantity.weight) if quantity.weight else np.ones(len(runs))
    if quantity.is_root:  # the root of the mean square of all, linearised there: intervals have the unit of the root
        square = float(np.nansum(weight * values**2) / max(np.nansum(weight), 1.0))
        return weight * (values**2 + square) / (2.0 * np.sqrt(square) or 1.0), weight
    return values * weight if quantity.scale is None else quantity.scale * values, weight


def summed_by(
    column: str, runs: pd.DataFrame, sums: FloatArray, weight: FloatArray, every: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the totals over runs that have the same value in a column; runs without a sum count nothing.

    ``every`` has the sorted values whose totals are wanted; None for those of the runs.
    """
    known, own = np.isfinite(sums) & np.isfinite(weight), runs[column].to_numpy()
    values = np.unique(own) if every is None else every
    group = np.searchsorted(values, own)
    summed, counted = (
        np.bincount(group, weights=np.where(known, each, 0.0), minlength=len(values)) for each in (sums, weight)
    )
    return summed.astype(np.float64), counted.astype(np.float64)


def _break(label: str, runs: pd.DataFrame) -> Break:
    judged = next(quantity for quantity in curve_quantities() if quantity.key == BREAK_METRIC)
    seeds = np.unique(runs["seed"].to_numpy())
    kept, shares, influences = [], [], []
    for density, at_density in runs.groupby("density", sort=True):
        sums, events = summed_by("seed", at_density, *sums_and_weights(at_density, judged), seeds)
        if (total := events.sum()) >= FEWEST_EVENTS:
            kept.append(float(str(density)))
            shares.append(sums.sum() / total)
            influences.append((sums - shares[-1] * events) / total)
    if not kept:
        return Break(label, None, None, None, False)
    # Interpolated seed by seed, since the share between two densities is less uncertain than at either of them.
    densities = np.union1d(kept, np.linspace(kept[0], kept[-1], STEPS))
    share = np.interp(densities, kept, shares)
    interval = None
    if (n := len(seeds)) > 1:
        squares = sum(np.interp(densities, kept, of_seed) ** 2 for of_seed in np.array(influences).T)
        half = special.stdtrit(n - 1, 1.0 - 0.5 * LEVEL) * np.sqrt(n / (n - 1) * squares)
        low, high = (_crossing(densities, line) for line in (share - half, share + half))
        interval = None if low is None else (low, high)
    crossing = _crossing(densities, share)
    return Break(label, crossing, interval, kept[-1], crossing == kept[0])


def _crossing(densities: FloatArray, shares: FloatArray) -> float | None:
    """Return where the share first falls below the limit, interpolated; None where it never does."""
    below = shares < BREAK_PERCENT
    if not below.any():
        return None
    fall = slice(max(int(below.argmax()) - 1, 0), int(below.argmax()) + 1)
    return float(np.interp(-BREAK_PERCENT, -shares[fall], densities[fall]))


def points_of(points: Sequence[Point], axis: str, metric: str) -> Iterator[tuple[str, list[Point]]]:
    """Yield each label's points of one quantity over one axis, sorted along it."""
    chosen = [point for point in points if point.axis == axis and point.metric == metric and point.mean is not None]
    for label in dict.fromkeys(point.label for point in points):
        yield label, sorted((point for point in chosen if point.label == label), key=lambda point: point.value)
