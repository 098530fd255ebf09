"""Scores of each tracker pooled over all recordings of a folder, with intervals over the recordings."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from harness.analysis.coasting_ratio import kinds_hidden_on_purpose, on_purpose
from harness.analysis.curves import Ratio, labelled, ratio_of, summed_by, sums_and_weights
from harness.scoring.metrics.quantity import Quantity
from harness.scoring.metrics.registry import view
from harness.storage.grid_folder import column_of
from harness.storage.schema import RECORDING
from mmpf.numerics.arrays import FloatArray

# What the scores are called in the file: the headline of hidden vehicles, multi-object scores, errors, the rest.
POOLED = {
    "hidden.hidden_cost_m": "hidden_cost_m", "hidden.false_hidden_tracks_per_scan": "false_hidden_tracks_per_scan",
    "hidden.identity_cost_m": "hidden_identity_cost_m", "hidden.hidden_crps_m": "hidden_crps_m",
    "mot.hota": "hota", "mot.idf1": "idf1", "mot.id_switches": "id_switches_per_vehicle_minute",
    "mae.visible.lon_m": "mae.visible.lon_m", "mae.visible.n": "visible_followed",
    "mae.hidden.lon_m": "mae.hidden.lon_m", "mae.hidden.n": "hidden_followed",
    "gospa_remembered.mean": "gospa_remembered_m", "occlusion.same_id": "same_id",
    **{
        f"gaps.{kind}.{score}": f"{name}_{kind}"
        for kind in ("all", "moving", "parked")
        for score, name in (
            ("same_id", "same_id_after_gaps"),
            ("long_same_id", "same_id_after_1_s"),
            ("position_m", "position_m"),
        )
    },
}  # fmt: skip
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
        mean: The mean; None without a sample.
        ci95: Student's interval over files; None with fewer than two files.
        n: Samples behind it; of a ratio, what it is a ratio of, summed.
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
    """Pool the runs over recorded files; a run that failed leaves its file out for its tracker alone.

    A file is one scene, whichever egos carry the sensor in it: it is what intervals take for independent.
    """
    done = labelled(table)
    groups = [(str(label), runs) for label, runs in done.groupby("label", sort=False)]
    switches = {label: int(runs["mot.id_switches"].sum()) for label, runs in groups}
    hidden = [error for label, runs in groups for error in _hidden_errors(label, runs)]
    told = [each for each in pooled_quantities() if not each.is_of_some_runs or each.key in done]
    told += on_purpose(kinds_hidden_on_purpose(done))
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
    return Mean(label, pooled_name(quantity), *ratio_of(sums, counts, quantity.possible), round(float(counts.sum())))


def _hidden_errors(label: str, runs: pd.DataFrame) -> list[HiddenError]:
    prefix, ending = "against_coasting.by_seconds_hidden.", ".from_s"
    names = [str(name) for name in runs]
    bins = [name.removesuffix(ending) for name in names if name.startswith(prefix) and name.endswith(ending)]
    errors = []
    for key in (*sorted(bins, key=lambda key: int(key.removeprefix(prefix))), "against_coasting.hidden"):
        n, own, coasting = (column_of(runs, f"{key}.{name}") for name in ("n", "lon_m", "coasting_lon_m"))
        from_s, to_s = (float(runs[f"{key}.{end}"].iloc[0]) if key in bins else None for end in ("from_s", "to_s"))
        lon_m, ratio = _over_files(runs, own * n, n), _over_files(runs, own * n, coasting * n)
        coasting_m, _ = _over_files(runs, coasting * n, n)
        followed = _followed(runs, key.removeprefix(prefix) if key in bins else "")
        errors.append(HiddenError(label, from_s or 0.0, to_s, *lon_m, coasting_m, *ratio, int(np.nansum(n)), followed))
    return errors


def _followed(runs: pd.DataFrame, number: str) -> float | None:
    """Return the share of the hidden vehicle-steps of a bin, or of all, that the tracker follows."""
    key = f"mae.by_seconds_hidden.{number}" if number else "hidden_outcomes"
    share, n = column_of(runs, f"{key}.tracked_percent"), column_of(runs, f"{key}.{'hidden_n' if number else 'n'}")
    return _over_files(runs, share * n, n)[0]


def _over_files(runs: pd.DataFrame, sums: FloatArray, counts: FloatArray) -> Ratio:
    return ratio_of(*summed_by(RECORDING, runs, sums, counts))
