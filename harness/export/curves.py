"""A run as curves over time: errors of visible and hidden vehicles, and their numbers."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from harness.running.finished import RecordedRun
from harness.storage.tables import floats
from mmpf.numerics.arrays import FloatArray, IntArray

SEEN, HIDDEN = ("visible", "partial"), ("hidden",)
TRACKED = "tracked"


@dataclass(frozen=True)
class Curves:
    """Curves over the steps of a run.

    Attributes:
        time_s: Time of each step, shape (n,).
        error_m: Mean distance between vehicle and track of those that are followed, ``seen`` and ``hidden``, each of
            shape (n,); nan at steps without any.
        count: How many there were, by what, each of shape (n,).
    """

    time_s: FloatArray
    error_m: Mapping[str, FloatArray]
    count: Mapping[str, FloatArray]


def curves_of(run: RecordedRun) -> Curves:
    """Return the curves of a run."""
    truth = run.truth
    steps, first = np.unique(truth["step"].to_numpy(), return_index=True)
    others = truth[~truth["is_ego"].to_numpy(dtype=bool) & truth["in_range"].to_numpy(dtype=bool)]
    return Curves(
        time_s=floats(truth, "time_s")[first],
        error_m={"seen": _mean_error(run, others, SEEN, steps), "hidden": _mean_error(run, others, HIDDEN, steps)},
        count={
            "seen vehicles": _counted(others[others["state"].isin(SEEN)], steps),
            "hidden vehicles": _counted(others[others["state"].isin(HIDDEN)], steps),
            "detections": _counted(run.detections, steps),
            "tracks": _counted(run.reported, steps),
            "tracks taken for hidden": _counted(run.reported[run.reported["state"] == "hidden"], steps),
        },
    )


def _counted(table: pd.DataFrame, steps: IntArray) -> FloatArray:
    count = table.groupby("step").size().reindex(steps, fill_value=0)
    return np.asarray(count, dtype=np.float64)


def _mean_error(run: RecordedRun, vehicles: pd.DataFrame, states: tuple[str, ...], steps: IntArray) -> FloatArray:
    named = {"vehicle_id": object}
    chosen = vehicles.loc[vehicles["state"].isin(states), ["step", "vehicle_id"]].astype(named)
    followed = run.errors[run.errors["outcome"] == TRACKED].astype(named).merge(chosen, on=["step", "vehicle_id"])
    far = np.hypot(floats(followed, "lon_error_m"), floats(followed, "lat_error_m"))
    mean = pd.Series(far).groupby(followed["step"].to_numpy()).mean()
    return np.asarray(mean.reindex(steps), dtype=np.float64)
