"""AMOTA and AMOTP as nuScenes defines them: accuracy and precision of tracking, averaged over recalls.

Weng et al. (2020), with the recall-normalised accuracy MOTAR of the nuScenes tracking task, whose weight of errors is 1
as in its program 1.2.0: boxes match within 2 m of their centres on the ground, class by class; only tracks
above the score that gives a recall count, for 40 recalls from 10 to 100 %; a recall that is not reached counts as the
worst value.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment

from mmpf.numerics.arrays import FloatArray

GATE_M, RECALLS, LOWEST_RECALL = 2.0, 40, 0.1
WORST = (0.0, GATE_M)
"""AMOTA and AMOTP of a recall that is not reached."""
FAR_M = 1e6


@dataclass(frozen=True)
class ByRecall:
    """Scores of a class.

    Attributes:
        amota: Mean accuracy over the recalls, 0 to 1.
        amotp: Mean distance of matched boxes over the recalls.
    """

    amota: float
    amotp: float


@dataclass(frozen=True)
class Outcomes:
    """How boxes of a class match.

    Attributes:
        matches: Matches to the same track as before, or to a first one.
        switches: Matches to another track.
        missed: Boxes of the truth without a match.
        false: Boxes of tracks without one.
        distance_m: Sum of the distances of matches and switches.
        scores: Scores of the tracks of ``matches``.
    """

    matches: int
    switches: int
    missed: int
    false: int
    distance_m: float
    scores: FloatArray


def scores_by_class(truth: pd.DataFrame, tracks: pd.DataFrame, times: pd.DataFrame) -> Mapping[str, ByRecall]:
    """Score the tracks of each class that the truth has.

    Args:
        truth: A row for each box, with ``scene``, ``time_s``, ``id``, ``category``, ``x_m`` and ``y_m``.
        tracks: Likewise, and ``score``; a track's score is the mean of its boxes'.
        times: ``scene`` and ``time_s`` of every sample.
    """
    tracks = tracks.assign(score=tracks.groupby(["scene", "id"])["score"].transform(lambda own: own.to_numpy().mean()))
    truth, tracks = filled_in(truth.assign(score=0.0), times), filled_in(tracks, times)
    classes = sorted(truth["category"].unique())
    return {name: _of_class(*(rows[rows["category"] == name] for rows in (truth, tracks))) for name in classes}


def filled_in(boxes: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """Return the boxes, and between the first and the last of each identity those of samples without, interpolated."""
    at: dict[object, FloatArray] = {scene: np.sort(own.to_numpy()) for scene, own in times.groupby("scene")["time_s"]}
    parts = [boxes]
    for (scene, _), own in boxes.sort_values("time_s").groupby(["scene", "id"], sort=False):
        known = own["time_s"].to_numpy()
        missing = np.setdiff1d(at[scene][(at[scene] > known[0]) & (at[scene] < known[-1])], known)
        if len(missing):
            place = np.searchsorted(known, missing)
            # nuScenes' own program weighs the box after by the time to it; in a gap of one sample that is a half.
            after = (known[place] - missing) / (known[place] - known[place - 1])
            values = {name: own[name].to_numpy() for name in ("x_m", "y_m", "score")}
            values = {name: (1.0 - after) * each[place - 1] + after * each[place] for name, each in values.items()}
            parts.append(own.iloc[place].assign(time_s=missing, **values))
    return pd.concat(parts, ignore_index=True)


def _of_class(truth: pd.DataFrame, tracks: pd.DataFrame) -> ByRecall:
    scores = np.sort(_outcomes(truth, tracks).scores)[::-1]
    if not len(scores):
        return ByRecall(*WORST)
    recalls = np.linspace(LOWEST_RECALL, 1.0, RECALLS).round(12)
    reached = np.arange(1, len(scores) + 1) / len(truth)
    thresholds = np.interp(recalls, reached, scores, right=0.0)[recalls <= reached[-1]]
    values = np.full((RECALLS, 2), WORST)
    known: dict[float, tuple[float, float]] = {}
    for place, threshold in enumerate(thresholds.tolist()):
        if threshold not in known:
            known[threshold] = _accuracy_and_precision(_outcomes(truth, tracks[tracks["score"] >= threshold]))
        values[place] = known[threshold]
    return ByRecall(*values.mean(axis=0).tolist())


def _accuracy_and_precision(found: Outcomes) -> tuple[float, float]:
    """Return MOTAR and MOTP, or the worst values where there is no match."""
    everything = found.matches + found.switches + found.missed
    matched = found.matches + found.switches
    wrong = found.missed + found.switches + found.false - (everything - found.matches)
    accuracy = max(0.0, 1.0 - wrong / found.matches) if found.matches else WORST[0]
    return accuracy, found.distance_m / matched if matched else WORST[1]


def _outcomes(truth: pd.DataFrame, tracks: pd.DataFrame) -> Outcomes:
    """Match sample by sample: first each vehicle with its last track, if that is near; then the nearest pairs."""
    matches = switches = 0
    distance_m, scores = 0.0, list[float]()
    last: dict[tuple[object, object], object] = {}
    there = dict(list(tracks.groupby(["scene", "time_s"], sort=False)))
    for when, own in truth.groupby(["scene", "time_s"]):
        if when not in there:
            continue
        near = there[when]
        away = np.hypot(*(own[name].to_numpy()[:, None] - near[name].to_numpy() for name in ("x_m", "y_m")))
        away[away >= GATE_M] = np.inf
        vehicles = [(when[0], name) for name in own["id"]]
        names, score = near["id"].tolist(), near["score"].to_numpy()
        free = np.ones(len(names), dtype=bool)
        for row, vehicle in enumerate(vehicles):
            column = names.index(last[vehicle]) if last.get(vehicle) in names else -1
            if column >= 0 and free[column] and np.isfinite(away[row, column]):
                free[column] = False
                matches += 1
                distance_m += away[row, column]
                scores.append(score[column])
                away[row] = np.inf
        away[:, ~free] = np.inf
        rows, columns = linear_sum_assignment(np.where(np.isfinite(away), away, FAR_M))
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            if not np.isfinite(away[row, column]):
                continue
            same = last.get(vehicles[row], names[column]) == names[column]
            last[vehicles[row]] = names[column]
            distance_m += away[row, column]
            matches, switches = matches + same, switches + (not same)
            if same:
                scores.append(score[column])
    matched = matches + switches
    return Outcomes(matches, switches, len(truth) - matched, len(tracks) - matched, distance_m, np.array(scores))
