"""Mean absolute errors by visibility and by time hidden, with intervals over vehicles.

The error of a hidden vehicle counts only while its track is alive and its own, so a tracker that soon lets go of hidden
vehicles has small errors over few rows: read it beside the share that is followed, compare trackers on the rows that
both follow (``harness.scoring.paired``), or take ``harness.scoring.hidden_cost``.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from harness.scoring.evidence import Evidence
from harness.scoring.hidden_outcomes import hidden_outcomes
from harness.scoring.quantity import Quantity
from harness.scoring.settings import TIME_TOLERANCE_S
from harness.scoring.statistics import cluster_bootstrap, group_sums
from harness.sensor.observation import HIDDEN, PARTIAL, VISIBLE
from mmpf.compute.arrays import BoolArray, FloatArray, IntArray

STATES = {"all": (VISIBLE, PARTIAL, HIDDEN), "visible": (VISIBLE,), "partial": (PARTIAL,), "hidden": (HIDDEN,)}
NAMES = ("lon_m", "lat_m", "speed_mps", "lat_speed_mps", "position_m")
VISIBLE_LON, VISIBLE_N, HIDDEN_LON, HIDDEN_N = "mae.visible.lon_m", "mae.visible.n", "mae.hidden.lon_m", "mae.hidden.n"
TWO_TO_THREE_S = "mae.by_seconds_hidden.2"
QUANTITIES = (
    Quantity(
        VISIBLE_LON, "MAE visible (while followed), m",
        decimals=2, heading="MAE seen m", weight=VISIBLE_N, compared=True, curve=True,
    ),
    Quantity(VISIBLE_LON, "MAE visible (while followed), m", decimals=3, weight=VISIBLE_N, pooled=VISIBLE_LON),
    Quantity(
        VISIBLE_N, "visible and followed, %", True,
        weight="mae.visible.of_n", scale=100.0, tabled=True, pooled="visible_followed",
    ),
    Quantity("mae.visible.speed_mps", "speed MAE visible, m/s", decimals=2, compared=True),
    Quantity("mae.partial.lon_m", "MAE partly hidden, m", decimals=2, compared=True),
    Quantity(HIDDEN_LON, "MAE hidden while followed, m", decimals=2, compared=True),
    Quantity(
        HIDDEN_LON, "MAE hidden (while followed), m",
        decimals=2, heading="MAE hidden m", weight=HIDDEN_N, curve=True, pooled=HIDDEN_LON,
    ),
    Quantity(
        HIDDEN_N, "hidden and followed, %", True,
        heading="followed %", weight="mae.hidden.of_n", scale=100.0, curve=True, pooled="hidden_followed",
    ),
    Quantity(HIDDEN_LON, "longitudinal error, hidden (while followed), m", decimals=2, ablated=True),
    Quantity("mae.hidden.followed_percent", "hidden and followed, %", True, ablated=True),
    Quantity(
        f"{TWO_TO_THREE_S}.lon_m", "MAE hidden 2-3 s (while followed), m",
        decimals=2, weight=f"{TWO_TO_THREE_S}.n", tabled=True,
    ),
    Quantity(
        f"{TWO_TO_THREE_S}.tracked_percent", "hidden 2-3 s and followed, %", True,
        weight=f"{TWO_TO_THREE_S}.hidden_n", tabled=True,
    ),
    Quantity("mae.hidden.speed_mps", "speed MAE hidden, m/s", decimals=2, compared=True),
)  # fmt: skip


def mean_errors_by_visibility(evidence: Evidence) -> dict[str, object]:
    """Return the mean errors of tracked vehicles by visibility state, and of hidden ones by time since detection.

    Returns:
        ``visible``, ``partial``, ``hidden`` and ``all`` three together, as ``mean_errors`` has them, with the number of
        vehicle-steps of which ``n`` were followed ``of_n`` and their share ``followed_percent``; and
        ``by_seconds_hidden``: one such table for each bin of vehicles last detected more than ``from_s`` and at most
        ``to_s`` ago, with their ``hidden_outcomes``.
    """
    errors, rng = evidence.errors, evidence.new_rng()

    def mean_of(chosen: BoolArray) -> dict[str, object]:
        kept = chosen & errors.tracked
        return mean_errors(errors.absolute[kept], errors.vehicle[kept], rng, evidence.settings.bootstrap_draws)

    def followed(chosen: BoolArray) -> dict[str, object]:
        share = 100.0 * float(errors.tracked[chosen].mean()) if chosen.any() else np.nan
        return {"of_n": int(chosen.sum()), "followed_percent": share}

    states = {name: np.isin(errors.state, codes) for name, codes in STATES.items()}
    table: dict[str, object] = {name: mean_of(chosen) | followed(chosen) for name, chosen in states.items()}
    bins: list[dict[str, object]] = []
    for from_s, to_s in pairwise(evidence.settings.hidden_bins_s):
        inside = (errors.seconds_hidden > from_s + TIME_TOLERANCE_S) & (
            errors.seconds_hidden <= to_s + TIME_TOLERANCE_S
        )
        outcomes = hidden_outcomes(errors.outcome[inside])
        bins.append({"from_s": from_s, "to_s": to_s, **mean_of(inside), "hidden_n": outcomes.pop("n"), **outcomes})
    table["by_seconds_hidden"] = bins
    return table


def mean_errors(absolute: FloatArray, vehicle: IntArray, rng: np.random.Generator, draws: int) -> dict[str, object]:
    """Average absolute errors over rows.

    Args:
        absolute: Absolute errors, columns as in ``ErrorArrays``, shape (n, 4). nan is left out.
        vehicle: Vehicle of each row, shape (n,).
        rng: Source of the resamples.
        draws: Number of resamples.

    Returns:
        Means, nan without rows, the number of rows ``n``, and the ends of each mean's 95 % bootstrap interval over
        vehicles under ``_ci95``, None with fewer than two. ``position_m`` is the mean Euclidean error of the position.
    """
    values = np.column_stack((absolute, np.hypot(absolute[:, 0], absolute[:, 1])))
    sums, counts = group_sums(values, np.unique(vehicle, return_inverse=True)[1])
    total = counts.sum(axis=0)
    means = np.divide(sums.sum(axis=0), total, out=np.full(values.shape[1], np.nan), where=total > 0)
    intervals = dict(zip(NAMES, cluster_bootstrap(sums, counts, rng, draws=draws), strict=True))
    return {
        **dict(zip(NAMES, means.tolist(), strict=True)),
        "n": len(values),
        **{f"{name}_ci95": None if np.isnan(ends.low) else [ends.low, ends.high] for name, ends in intervals.items()},
    }
