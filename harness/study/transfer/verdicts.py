"""What simulated training is worth on other traffic, said in so many words: won, lost, or neither."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from harness.scoring.statistics import bootstrap_ci
from harness.study.scores import RESAMPLES
from harness.study.targets import Target
from harness.study.transfer.models import ON_NOTHING, ON_REAL, ON_SUMO, UNTRAINED
from mmpf.road import FloatArray

if TYPE_CHECKING:
    from harness.study.transfer.transfer import Outcome

OURS = ("gmm", "gmm-short")
RIVALS = (*((name, ON_NOTHING) for name in UNTRAINED), ("idm-fitted", ON_SUMO))


def transfer_targets(outcomes: Sequence[Outcome]) -> list[Target]:
    """Hold the learned models that know simulated traffic alone against the rivals, and against real training.

    Every comparison is made case by case; its interval is over vehicles.
    """
    by_key = {
        (outcome.tested_on, outcome.model.name, outcome.model.trained_on, horizon): outcome
        for outcome in outcomes
        for horizon in outcome.part.horizons_s
    }
    places = list(dict.fromkeys((tested_on, horizon) for tested_on, _, _, horizon in by_key))
    targets = []
    for tested_on, horizon in places:
        for own in OURS:
            against = [*RIVALS, (own, ON_REAL)]
            targets += [
                _below(by_key[tested_on, own, ON_SUMO, horizon], by_key[tested_on, name, trained_on, horizon], horizon)
                for name, trained_on in against
                if (tested_on, own, ON_SUMO, horizon) in by_key and (tested_on, name, trained_on, horizon) in by_key
            ]
    return targets


def _below(own: Outcome, rival: Outcome, horizon_s: float) -> Target:
    own_m, rival_m = (_errors_at(outcome, horizon_s) for outcome in (own, rival))
    interval = bootstrap_ci(own_m - rival_m, np.random.default_rng(0), own.part.vehicle, draws=RESAMPLES)
    difference = float((own_m - rival_m).mean())
    clear = "clear" if interval.low > 0.0 or interval.high < 0.0 else "not clear"
    return Target(
        f"on {own.tested_on}, {own.model.label} below {rival.model.label} at {horizon_s:g} s",
        difference < 0.0,
        f"{own_m.mean():.2f} against {rival_m.mean():.2f} m, difference {difference:+.2f} "
        f"[{interval.low:+.2f}, {interval.high:+.2f}], {clear}",
    )


def _errors_at(outcome: Outcome, horizon_s: float) -> FloatArray:
    step = round(horizon_s / outcome.part.cases.step_s) - 1
    return np.asarray(outcome.scores.abs_error["lon_m"][step])
