"""Ratio of each tracker's hidden error to that of constant velocity, over the same vehicles.

Trackers that let go of different vehicles have mean errors over different vehicle-steps. Against one reference, on the
steps that tracker and reference both follow, their errors can be set beside each other. Of vehicles hidden on purpose
the reference is the true state extrapolated, over the windows at whose end the tracker follows the vehicle.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pandas as pd

from harness.scoring.metrics.pseudo_occlusion import NAME, SITUATIONS, USUAL_S
from harness.scoring.metrics.quantity import Quantity
from harness.storage.grid_rows import column_of
from mmpf.numerics.arrays import FloatArray

COASTING_TRACKER = "oracle-kalman"
HIDDEN, TWO_TO_THREE_S = "against_coasting.hidden.", "against_coasting.by_seconds_hidden.2."
OWN, COASTING, STEPS = "lon_m", "coasting_lon_m", "n"
RATIO, TOTAL = "ratio", "coasting_total_m"
QUANTITIES = (
    Quantity(HIDDEN + OWN, "MAE hidden where constant velocity follows too, m", decimals=2, weight=HIDDEN + STEPS),
    Quantity(HIDDEN + COASTING, "MAE of constant velocity there, m", decimals=2, weight=HIDDEN + STEPS),
    *(
        Quantity(part + RATIO, f"{name} to that of constant velocity", decimals=2, weight=part + TOTAL)
        for part, name in ((HIDDEN, "ratio"), (TWO_TO_THREE_S, "ratio, hidden 2-3 s,"))
    ),
)
ON_PURPOSE, WINDOWS, FOLLOWED, CONSTANT_TOTAL = f"{NAME}.", "windows", "followed_windows", "constant_velocity_total_m"
ON_PURPOSE_SCORES = (
    Quantity("followed_percent", "followed, %", True, weight=WINDOWS),
    Quantity(RATIO, RATIO, decimals=2, weight=CONSTANT_TOTAL),
    Quantity("cost_m", "cost, m", decimals=2, weight=WINDOWS),
    Quantity("same_id_percent", "same identity, %", True, weight=WINDOWS),
    Quantity("ellipse90_percent", "in 90 % ellipse, %", True, weight=FOLLOWED),
)


def on_purpose(kinds: Iterable[str]) -> list[Quantity]:
    """Return the scores of vehicles hidden on purpose for given lengths and situations, weighed by what they are of."""
    places = ((f"{ON_PURPOSE}{kind}.", score) for kind in kinds for score in ON_PURPOSE_SCORES)
    return [replace(score, key=place + score.key, weight=place + score.weight) for place, score in places]


ON_PURPOSE_WEIGHTS = {each.key: each.weight for each in on_purpose(f"{seconds:g}s" for seconds in USUAL_S)}
RATIO_TOTALS = {key: weight for key, weight in ON_PURPOSE_WEIGHTS.items() if key.endswith(f".{RATIO}")}


def kinds_hidden_on_purpose(runs: pd.DataFrame) -> list[str]:
    """Return the lengths (``3s``), shortest first, then the situations, that any run has windows of."""
    found = {name.removeprefix(ON_PURPOSE).rpartition(".")[0] for name in map(str, runs) if name.startswith(ON_PURPOSE)}
    lengths = sorted((kind for kind in found if kind[:1].isdigit()), key=lambda kind: float(kind.removesuffix("s")))
    kinds = (*lengths, *SITUATIONS)
    return [kind for kind in kinds if (column_of(runs, f"{ON_PURPOSE}{kind}.{WINDOWS}") > 0.0).any()]


def with_ratios(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs with each one's ratio to coasting, and the ratio's weight: the summed error of constant velocity.

    So weighed, the mean of the ratios over runs is the ratio of all errors together. Of vehicles hidden on purpose the
    number of followed windows comes too.
    """
    columns: dict[str, FloatArray] = {}
    for part in (HIDDEN, TWO_TO_THREE_S):
        own, coasting, n = (column_of(runs, part + name) for name in (OWN, COASTING, STEPS))
        columns |= {part + RATIO: own / coasting, part + TOTAL: coasting * n}
    for place in (f"{ON_PURPOSE}{kind}." for kind in kinds_hidden_on_purpose(runs)):
        followed = column_of(runs, place + WINDOWS) * column_of(runs, f"{place}followed_percent") / 100.0
        total_m = followed * column_of(runs, f"{place}constant_velocity_m")
        columns |= {place + FOLLOWED: followed, place + CONSTANT_TOTAL: total_m}
    return runs.assign(**columns)
