"""Scores of each tracker pooled over all recordings of a folder, with intervals over the recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.analysis.curves import labelled, summed_by, sums_and_weights
from harness.common.intervals import NONNEGATIVE, Possible, possible_ci
from harness.scoring.metrics.quantity import Quantity
from harness.scoring.metrics.registry import view
from harness.storage.grid_rows import column_of
from harness.storage.schema import RECORDING
from mmpf.numerics.arrays import FloatArray

if TYPE_CHECKING:
    import pandas as pd


# What the scores are called in the file: the headline of hidden vehicles, multi-object scores, errors, the rest.
POOLED = {
    "hidden.hidden_cost_m": "hidden_cost_m",
    "hidden.false_hidden_tracks_per_scan": "false_hidden_tracks_per_scan",
    "hidden.identity_cost_m": "hidden_identity_cost_m",
    "mot.hota": "hota",
    "mot.idf1": "idf1",
    "mot.id_switches": "id_switches_per_vehicle_minute",
    "mae.visible.lon_m": "mae.visible.lon_m",
    "mae.visible.n": "visible_followed",
    "mae.hidden.lon_m": "mae.hidden.lon_m",
    "mae.hidden.n": "hidden_followed",
    "gospa_remembered.mean": "gospa_remembered_m",
    "occlusion.same_id": "same_id",
    **{
        f"pseudo_occlusion.{key}.{score}": f"{score}_hidden_on_purpose_{key}"
        for key in ("1s", "2s", "3s", "5s")
        for score in ("cost_m", "ratio", "same_id_percent", "ellipse90_percent")
    },
    **{
        f"gaps.{kind}.{score}": f"{name}_{kind}"
        for kind in ("all", "moving", "parked")
        for score, name in (
            ("same_id", "same_id_after_gaps"),
            ("long_same_id", "same_id_after_1_s"),
            ("position_m", "position_m"),
        )
    },
}
IN_WORDS: dict[str, dict[str, Any]] = {
    "mot.hota": {"weight": "mot.truth_n"},
    "mae.visible.lon_m": {"decimals": 3},
    "mae.hidden.lon_m": {"label": "MAE hidden (while followed), m"},
}


def pooled_quantities() -> list[Quantity]:
    """Return the columns of the table."""
    return view(POOLED, IN_WORDS)


def pooled_name(quantity: Quantity) -> str:
    """Return what a score is called in the file; a metric from outside by its key."""
    return POOLED.get(quantity.key, quantity.key)


@dataclass(frozen=True)
class Mean:
    """A mean over all files.

    Attributes:
        tracker: The tracker with its settings and model.
        quantity: Key of the quantity.
        mean: The mean; None without a sample.
        ci95: Bootstrap interval over files; None with fewer than two files.
        n: Samples behind it.
    """

    tracker: str
    quantity: str
    mean: float | None
    ci95: tuple[float, float] | None
    n: int


@dataclass(frozen=True)
class HiddenError:
    """Mean absolute longitudinal errors of hidden vehicles beside those of coasting on the same vehicle-steps.

    Attributes:
        from_s: Last detected more than so long ago, and at most ``to_s``; None for all times together.
        ratio: One over the other; intervals are over files.
        n: Vehicle-steps.
        followed_percent: Share of all such vehicle-steps that the tracker follows.
    """

    tracker: str
    from_s: float
    to_s: float | None
    lon_m: float | None
    lon_m_ci95: tuple[float, float] | None
    coasting_lon_m: float | None
    ratio: float | None
    ratio_ci95: tuple[float, float] | None
    n: int
    followed_percent: float | None


@dataclass(frozen=True)
class FileCount:
    """How many vehicles of a file were driven, how many carried the sensor, and the runs over it that ended well."""

    file: str
    vehicles_read: int
    vehicles_kept: int
    vehicles_left_out: int
    egos: int
    runs: int


@dataclass(frozen=True)
class Pooled:
    """All results of a grid over recorded traffic: files, and each tracker's identity switches, scores and errors.

    Errors of hidden vehicles are by the time since the last detection, all times together last.
    """

    files: Sequence[FileCount]
    id_switches: dict[str, int]
    means: Sequence[Mean]
    hidden: Sequence[HiddenError]


def pool_files(table: pd.DataFrame) -> Pooled:
    """Pool the runs over recorded files; a run that failed leaves its file out for its tracker alone."""
    done = labelled(table)
    groups = [(str(label), runs) for label, runs in done.groupby("label", sort=False)]
    switches = {label: int(runs["mot.id_switches"].sum()) for label, runs in groups}
    hidden = [error for label, runs in groups for error in _hidden_errors(label, runs)]
    told = [each for each in pooled_quantities() if not each.is_of_some_runs or each.key in done]
    means = [_mean(label, quantity, runs) for label, runs in groups for quantity in told]
    return Pooled(_files(done), switches, means, hidden)


def _files(done: pd.DataFrame) -> list[FileCount]:
    counts = []
    keys = [f"recording.{key}" for key in ("vehicles_read", "vehicles_kept", "egos")]
    told = done.reindex(columns=[RECORDING, *keys]).dropna()  # finished runs of simulated traffic count none
    for name, runs in told.groupby(RECORDING, sort=False):
        read, kept, egos = (int(runs[key].iloc[0]) for key in keys)
        counts.append(FileCount(str(name), read, kept, read - kept, egos, len(runs)))
    return counts


def _mean(label: str, quantity: Quantity, runs: pd.DataFrame) -> Mean:
    sums, counts = summed_by(RECORDING, runs, *sums_and_weights(runs, quantity))
    mean, interval = _ratio(sums, counts, quantity.possible)
    return Mean(label, pooled_name(quantity), mean, interval, int(counts.sum()))


def _hidden_errors(label: str, runs: pd.DataFrame) -> list[HiddenError]:
    prefix = "against_coasting.by_seconds_hidden."
    names = [str(name) for name in runs]
    bins = sorted({int(name.removeprefix(prefix).split(".")[0]) for name in names if name.startswith(prefix)})
    errors = []
    for key in (*(f"{prefix}{number}" for number in bins), "against_coasting.hidden"):
        n, own, coasting = (
            runs[f"{key}.{name}"].to_numpy(dtype=np.float64) for name in ("n", "lon_m", "coasting_lon_m")
        )
        own_sums, counts = summed_by(RECORDING, runs, own * n, n)
        coasting_sums, _ = summed_by(RECORDING, runs, coasting * n, n)
        is_bin = f"{key}.from_s" in runs
        lon_m, lon_interval = _ratio(own_sums, counts)
        ratio, ratio_interval = _ratio(own_sums, coasting_sums)
        errors.append(
            HiddenError(
                tracker=label,
                from_s=float(runs[f"{key}.from_s"].iloc[0]) if is_bin else 0.0,
                to_s=float(runs[f"{key}.to_s"].iloc[0]) if is_bin else None,
                lon_m=lon_m,
                lon_m_ci95=lon_interval,
                coasting_lon_m=_ratio(coasting_sums, counts)[0],
                ratio=ratio,
                ratio_ci95=ratio_interval,
                n=int(counts.sum()),
                followed_percent=_followed(runs, key.removeprefix(prefix) if is_bin else ""),
            )
        )
    return errors


def _followed(runs: pd.DataFrame, number: str) -> float | None:
    """Return the share of the hidden vehicle-steps of a bin, or of all, that the tracker follows."""
    key = f"mae.by_seconds_hidden.{number}" if number else "hidden_outcomes"
    share, n = column_of(runs, f"{key}.tracked_percent"), column_of(runs, f"{key}.{'hidden_n' if number else 'n'}")
    return _ratio(*summed_by(RECORDING, runs, share * n, n))[0]


def _ratio(
    sums: FloatArray, counts: FloatArray, possible: Possible = NONNEGATIVE
) -> tuple[float | None, tuple[float, float] | None]:
    """Return the ratio of the totals and its interval over files."""
    total = float(counts.sum())
    if total <= 0.0:
        return None, None
    interval = possible_ci(sums, counts, possible)
    ends = (interval.low, interval.high) if np.isfinite(interval.low) else None
    return float(sums.sum()) / total, ends
