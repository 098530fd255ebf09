"""Mean absolute errors by visibility and by time hidden, with intervals over vehicles."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from harness.scoring.errors import HIJACKED, LOST, OUTCOMES, TRACKED, UNTRACKED
from harness.scoring.settings import TIME_TOLERANCE_S, ScoringSettings
from harness.scoring.statistics import Interval, cluster_bootstrap, group_sums
from harness.sensor.observation import HIDDEN, PARTIAL, VISIBILITY_STATES, VISIBLE
from mmpf.compute.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class ErrorArrays:
    """The numbers of the error table, struct of arrays of shape (n,).

    Attributes:
        vehicle: Code of the vehicle.
        absolute: Absolute errors of longitudinal and lateral position, longitudinal and lateral speed, shape (n, 4).
        state: Index into the visibility states.
        seconds_hidden: Time since the last detection, 0 where not hidden.
        outcome: Index into ``harness.scoring.errors.OUTCOMES``.
    """

    vehicle: IntArray
    absolute: FloatArray
    state: IntArray
    seconds_hidden: FloatArray
    outcome: IntArray

    @property
    def tracked(self) -> BoolArray:
        """Rows that belong in a mean, shape (n,)."""
        return np.equal(self.outcome, TRACKED)


@dataclass(frozen=True)
class MeanErrors:
    """Mean absolute errors of a set of rows, each with its 95 % bootstrap interval over vehicles."""

    lon_m: float
    lat_m: float
    speed_mps: float
    lat_speed_mps: float
    position_m: float
    n: int
    lon_m_ci95: Interval
    lat_m_ci95: Interval
    speed_mps_ci95: Interval
    lat_speed_mps_ci95: Interval
    position_m_ci95: Interval


@dataclass(frozen=True)
class HiddenOutcomes:
    """What became of hidden vehicles, in percent of vehicle-steps hidden; nan without any.

    Attributes:
        n: Vehicle-steps hidden, from the first detection on, up to the memory.
        tracked_percent: The track that held the vehicle is alive and on no other vehicle.
        lost_percent: It is gone.
        hijacked_percent: It is on another vehicle.
        untracked_percent: No track held the vehicle at its last detection.
    """

    n: int
    tracked_percent: float
    lost_percent: float
    hijacked_percent: float
    untracked_percent: float


@dataclass(frozen=True)
class HiddenBin:
    """Errors and outcomes of hidden vehicles last detected more than ``from_s`` and at most ``to_s`` ago."""

    from_s: float
    to_s: float
    errors: MeanErrors
    outcomes: HiddenOutcomes


def error_arrays(errors: pd.DataFrame) -> ErrorArrays:
    """Take the numbers out of an error table, also out of one that was read back from a file."""
    columns = ("lon_error_m", "lat_error_m", "speed_error_mps", "lat_speed_error_mps")
    names = pd.factorize(errors["vehicle_id"])[0].astype(np.int64)
    episode = errors["episode"].to_numpy(dtype=np.int64)
    return ErrorArrays(
        vehicle=episode * (int(names.max(initial=0)) + 1) + names,
        absolute=np.abs(np.column_stack([errors[column].to_numpy(dtype=np.float64) for column in columns])),
        state=_codes(errors["state"], VISIBILITY_STATES),
        seconds_hidden=errors["seconds_hidden"].to_numpy(dtype=np.float64),
        outcome=_codes(errors["outcome"], OUTCOMES),
    )


def errors_by_state(errors: ErrorArrays, settings: ScoringSettings, rng: np.random.Generator) -> dict[str, MeanErrors]:
    """Average the errors of tracked vehicles by visibility state; ``all`` is over the three states together."""
    states = {"all": (VISIBLE, PARTIAL, HIDDEN), "visible": (VISIBLE,), "partial": (PARTIAL,), "hidden": (HIDDEN,)}
    return {
        name: _mean_of(errors, errors.tracked & np.isin(errors.state, codes), settings, rng)
        for name, codes in states.items()
    }


def errors_by_time_hidden(
    errors: ErrorArrays, settings: ScoringSettings, rng: np.random.Generator
) -> tuple[HiddenBin, ...]:
    """Average the errors of hidden vehicles by the time since their last detection."""
    bins = []
    for from_s, to_s in pairwise(settings.hidden_bins_s):
        inside = (errors.seconds_hidden > from_s + TIME_TOLERANCE_S) & (
            errors.seconds_hidden <= to_s + TIME_TOLERANCE_S
        )
        means = _mean_of(errors, inside & errors.tracked, settings, rng)
        bins.append(HiddenBin(from_s, to_s, means, hidden_outcomes(errors.outcome[inside])))
    return tuple(bins)


def hidden_outcomes(outcome: IntArray) -> HiddenOutcomes:
    """Count the outcomes of hidden vehicle-steps, shape (n,)."""

    def percent(code: int) -> float:
        return 100.0 * float((outcome == code).mean()) if len(outcome) else np.nan

    return HiddenOutcomes(len(outcome), percent(TRACKED), percent(LOST), percent(HIJACKED), percent(UNTRACKED))


def mean_errors(absolute: FloatArray, vehicle: IntArray, rng: np.random.Generator, draws: int) -> MeanErrors:
    """Average absolute errors over rows.

    Args:
        absolute: Absolute errors, columns as in ``ErrorArrays``, shape (n, 4). nan is left out.
        vehicle: Vehicle of each row, shape (n,).
        rng: Source of the resamples.
        draws: Number of resamples.

    Returns:
        Means; nan without rows. ``position_m`` is the mean Euclidean error of the position.
    """
    values = np.column_stack((absolute, np.hypot(absolute[:, 0], absolute[:, 1])))
    sums, counts = group_sums(values, np.unique(vehicle, return_inverse=True)[1])
    total = counts.sum(axis=0)
    means = np.divide(sums.sum(axis=0), total, out=np.full(values.shape[1], np.nan), where=total > 0)
    lon, lat, speed, lat_speed, position = cluster_bootstrap(sums, counts, rng, draws=draws)
    return MeanErrors(
        lon_m=float(means[0]),
        lat_m=float(means[1]),
        speed_mps=float(means[2]),
        lat_speed_mps=float(means[3]),
        position_m=float(means[4]),
        n=len(values),
        lon_m_ci95=lon,
        lat_m_ci95=lat,
        speed_mps_ci95=speed,
        lat_speed_mps_ci95=lat_speed,
        position_m_ci95=position,
    )


def _mean_of(errors: ErrorArrays, chosen: BoolArray, settings: ScoringSettings, rng: np.random.Generator) -> MeanErrors:
    return mean_errors(errors.absolute[chosen], errors.vehicle[chosen], rng, settings.bootstrap_draws)


def _codes(labels: pd.Series[str], names: tuple[str, ...]) -> IntArray:
    return pd.Categorical(labels, categories=list(names)).codes.astype(np.int64)
