"""Ratio of each tracker's hidden error to that of constant velocity, over the same vehicles.

Trackers that let go of different vehicles have mean errors over different vehicle-steps. Against one reference, on the
steps that tracker and reference both follow, their errors can be set beside each other. Of vehicles hidden on purpose
the reference is the true state extrapolated, over the windows at whose end the tracker follows the vehicle.
"""

from collections.abc import Iterable
from functools import partial

import pandas as pd

from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M
from harness.scoring.metrics.pseudo_occlusion import CONSTANT, FOLLOWED, JUDGED, NAME, SITUATIONS, USUAL_S, WINDOWS
from harness.scoring.metrics.quantity import Columns, Quantity, of_kinds
from harness.storage.grid_folder import column_of
from mmpf.numerics.arrays import FloatArray

COASTING_TRACKER = "oracle-kalman"
HIDDEN, TWO_TO_THREE_S = "against_coasting.hidden.", "against_coasting.by_seconds_hidden.2."
OWN, COASTING, STEPS = "lon_m", "coasting_lon_m", "n"
RATIO = "ratio"


def errors_of_runs(column: Columns, part: str) -> tuple[FloatArray, FloatArray]:
    """Return each run's summed errors of a part and those of coasting there, both of shape (runs,)."""
    own, coasting, n = (column(part + name) for name in (OWN, COASTING, STEPS))
    return own * n, coasting * n


QUANTITIES = (
    Quantity(HIDDEN + OWN, "MAE hidden where constant velocity follows too, m", decimals=2, weight=HIDDEN + STEPS),
    Quantity(HIDDEN + COASTING, "MAE of constant velocity there, m", decimals=2, weight=HIDDEN + STEPS),
    *(
        Quantity(
            part + RATIO, f"{name} to that of constant velocity", decimals=2, pooled=partial(errors_of_runs, part=part)
        )
        for part, name in ((HIDDEN, "ratio"), (TWO_TO_THREE_S, "ratio, hidden 2-3 s,"))
    ),
)
ON_PURPOSE = f"{NAME}."
ON_PURPOSE_SCORES = (
    Quantity("followed_percent", "followed, %", True, weight=WINDOWS),
    Quantity(RATIO, RATIO, decimals=2, weight=CONSTANT),
    Quantity("cost_m", "cost, m", decimals=2, limit=FOLLOW_CUTOFF_M, weight=WINDOWS),
    Quantity("same_id_percent", "same identity, %", True, weight=JUDGED),
    Quantity("ellipse90_percent", "in 90 % ellipse, %", best=90.0, weight=FOLLOWED),
)


def on_purpose(kinds: Iterable[str]) -> list[Quantity]:
    """Return the scores of vehicles hidden on purpose for given lengths and situations, weighed by what they are of."""
    return [*of_kinds(NAME, dict.fromkeys(kinds, ""), *ON_PURPOSE_SCORES)]


RATIO_TOTALS = {f"{NAME}.{length:g}s.{RATIO}": f"{NAME}.{length:g}s.{CONSTANT}" for length in USUAL_S}


def kinds_hidden_on_purpose(runs: pd.DataFrame) -> list[str]:
    """Return the lengths (``3s``), shortest first, then the situations, that any run has windows of."""
    found = {name.removeprefix(ON_PURPOSE).rpartition(".")[0] for name in map(str, runs) if name.startswith(ON_PURPOSE)}
    lengths = sorted((kind for kind in found if kind[:1].isdigit()), key=lambda kind: float(kind.removesuffix("s")))
    kinds = (*lengths, *SITUATIONS)
    return [kind for kind in kinds if (column_of(runs, f"{ON_PURPOSE}{kind}.{WINDOWS}") > 0.0).any()]
