"""Where test traffic lies in the ranges that the learned driver was trained on: why a model may not carry over."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from harness.study.transfer.models import TrainedModel
from harness.study.transfer.traffic import HeldOutSet
from mmpf.motion.features import situation
from mmpf.motion.learned_driver import LearnedDriver
from mmpf.road import FloatArray

INPUTS = ("log gap", "speed, m/s", "acceleration, m/s²", "closing speed, m/s", "leader's acceleration, m/s²")


def input_rows(models: Sequence[TrainedModel], tested: HeldOutSet) -> list[dict[str, Any]]:
    """Return a row for each learned driver and input.

    A row says how the true situations of the test traffic spread, and which share of them lies outside of the range
    of the training data, where the driver takes them for the range's end.

    Args:
        models: Models, of which those of the kind ``gmm`` count.
        tested: Test traffic.
    """
    seen = situations(tested)
    rows = []
    for entry in models:
        if not isinstance(entry.model, LearnedDriver):
            continue
        mixture = entry.model.model.following
        for place, name in enumerate(INPUTS):
            low, high = float(mixture.input_low[place]), float(mixture.input_high[place])
            values = seen[:, place]
            quantiles = np.quantile(values, (0.05, 0.95))
            rows.append(
                {
                    "tested_on": tested.name,
                    "trained_on": entry.trained_on,
                    "input": name,
                    "from_5_percent": float(quantiles[0]),
                    "to_95_percent": float(quantiles[1]),
                    "std": float(values.std()),
                    "trained_from": low,
                    "trained_to": high,
                    "outside_percent": 100.0 * float(((values < low) | (values > high)).mean()),
                }
            )
    return rows


def situations(tested: HeldOutSet) -> FloatArray:
    """Return all true situations of the windows behind a test set, shape (n, 5)."""
    led = tested.led
    columns = (led.gap_m, led.speed_mps, led.accel_mps2, led.leader_speed_mps, led.leader_accel_mps2)
    return situation(*(column.ravel() for column in columns))
