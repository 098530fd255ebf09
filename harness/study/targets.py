"""What the learned models are meant to reach, checked against a study's rows and said in so many words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from harness.study.study import COMPLETE, PARTIAL

Row = Mapping[str, Any]
OURS, PAPER, PAPER_CHANGE = "gmm", "gmm-short", "gmm-lane-change"


@dataclass(frozen=True)
class Target:
    """One target and whether it was met.

    Attributes:
        text: What was aimed at.
        met: Whether it was reached.
        measured: The numbers behind it.
    """

    text: str
    met: bool
    measured: str


def lane_keeping_targets(rows: Sequence[Row]) -> list[Target]:
    """Check the targets of the lane-keeping study."""
    by_key = {(row["occlusion"], row["model"], row["horizon_s"]): row for row in rows}
    models = list(dict.fromkeys(row["model"] for row in rows))
    horizons = sorted({row["horizon_s"] for row in rows if row["horizon_s"] is not None})
    targets: list[Target] = []
    if (COMPLETE, OURS, None) in by_key:
        complete = {key[1:]: row for key, row in by_key.items() if key[0] == COMPLETE}
        targets += _complete_targets(complete, models, horizons)
    if (PARTIAL, OURS, None) in by_key:
        partial = {key[1:]: row for key, row in by_key.items() if key[0] == PARTIAL}
        targets += _partial_targets(partial, models)
    return targets


def lane_change_targets(rows: Sequence[Row]) -> list[Target]:
    """Check the targets of the lane-change study at 5 s, where the line is crossed, and over the whole change.

    Either learned model is held against the kinematic ones, not against the other.
    """
    targets = []
    for own, other in ((OURS, PAPER_CHANGE), (PAPER_CHANGE, OURS)):
        for horizon, when in ((5.0, "at the crossing"), (None, "over the change")):
            at = {row["model"]: row for row in rows if row["horizon_s"] == horizon and row["model"] != other}
            text = f"partial occlusion: {own} below all kinematic models in {{}} velocity MAE {when}"
            targets.append(_smallest(at, "lat_speed_mps", text.format("lateral"), own))
            targets.append(_smallest(at, "speed_mps", text.format("longitudinal"), own))
    return targets


def _complete_targets(
    rows: Mapping[tuple[str, float], Row], models: Sequence[str], horizons: Sequence[float]
) -> list[Target]:
    targets = []
    for horizon in horizons:
        at = {model: rows[model, horizon] for model in models}
        targets.append(_smallest(at, "lon_m", f"complete occlusion: smallest position MAE at {horizon:g} s"))
        targets.append(_smallest(at, "crps_lon_m", f"complete occlusion: smallest CRPS at {horizon:g} s"))
        coverage = at[OURS]["coverage95_lon_m"]
        text = f"complete occlusion: {OURS}'s 95 % interval covers 90 to 98 % at {horizon:g} s"
        targets.append(Target(text, 0.90 <= coverage <= 0.98, f"{100 * coverage:.1f} %"))
        if horizon >= 2.0 and "idm" in at:
            targets.append(
                _apart(at[OURS], at["idm"], f"complete occlusion: intervals apart from idm at {horizon:g} s")
            )
        if horizon <= 5.0 and PAPER in at:
            targets.append(_paper_below_kinematics(at, horizon))
        if horizon == 5.0 and "cvm" in at:
            share = at[OURS]["lon_m"] / at["cvm"]["lon_m"]
            targets.append(
                Target("complete occlusion: below a third of cvm at 5 s", share < 1 / 3, f"{share:.2f} of it")
            )
    return targets


def _partial_targets(rows: Mapping[tuple[str, None], Row], models: Sequence[str]) -> list[Target]:
    means = {model: rows[model, None] for model in models}
    coverage = means[OURS]["coverage95_lon_m"]
    narrower, wider = means[OURS]["spread_lon_m"], means["cvm"]["spread_lon_m"]
    return [
        _smallest(means, "lon_m", "partial occlusion: smallest position MAE"),
        _smallest(means, "speed_mps", "partial occlusion: smallest velocity MAE"),
        Target("partial occlusion: spread below cvm's", narrower < wider, f"{narrower:.2f} against {wider:.2f} m"),
        Target(
            "partial occlusion: 95 % interval covers 90 to 99 %", 0.90 <= coverage <= 0.99, f"{100 * coverage:.1f} %"
        ),
    ]


def _smallest(rows: Mapping[str, Row], quantity: str, text: str, own_model: str = OURS) -> Target:
    rivals = {model: row[quantity] for model, row in rows.items() if model != own_model}
    best = min(rivals, key=lambda model: float(rivals[model]))
    own = rows[own_model][quantity]
    return Target(text, own < rivals[best], f"{own:.3f} against {rivals[best]:.3f} ({best})")


def _apart(own: Row, rival: Row, text: str) -> Target:
    high, low = own["lon_m_ci95"][1], rival["lon_m_ci95"][0]
    return Target(text, high < low, f"at most {high:.2f} against at least {low:.2f} m")


def _paper_below_kinematics(at: Mapping[str, Row], horizon: float) -> Target:
    best = min(at["cvm"]["lon_m"], at["cam"]["lon_m"])
    own = at[PAPER]["lon_m"]
    text = f"complete occlusion: {PAPER} below cvm and cam at {horizon:g} s"
    return Target(text, own < best, f"{own:.3f} against {best:.3f} m")
