"""How hard a vehicle is to detect, whatever is seen of it: a dark coat of paint, a body that reflects little."""

from __future__ import annotations

import numpy as np

from harness.config.sensor import SensorSettings
from harness.sensor.memory import SensorMemory
from harness.truth.frame import Frame
from mmpf.numerics.arrays import FloatArray


def detectabilities(settings: SensorSettings, memory: SensorMemory, frame: Frame) -> FloatArray:
    """Return the factor on each vehicle's detection probability, shape (n,), and remember those of new vehicles.

    A vehicle keeps its factor for the whole run. Factors come from a stream of their own, in the order in which the
    vehicles are met.
    """
    factor = np.ones(len(frame))
    if settings.detectability_share > 0.0:
        new = [name for name in frame.vehicle_id.tolist() if name not in memory.detectability]
        drawn = drawn_factors(settings, len(new), memory.streams.detectability)
        memory.detectability.update(zip(new, drawn.tolist(), strict=True))
        factor = np.array([memory.detectability[name] for name in frame.vehicle_id.tolist()])
    narrow = frame.width_m < settings.detectability_narrow_m
    return np.where(narrow, settings.detectability_narrow * factor, factor)


def drawn_factors(settings: SensorSettings, count: int, rng: np.random.Generator) -> FloatArray:
    """Draw the factors of vehicles: one of most, of the others ``least + (1 - least) * Beta``, shape (count,)."""
    least = settings.detectability_least
    mean, std = (settings.detectability_mean - least) / (1.0 - least), settings.detectability_spread / (1.0 - least)
    both = mean * (1.0 - mean) / std**2 - 1.0
    hard = rng.random(count) < settings.detectability_share
    return np.where(hard, least + (1.0 - least) * rng.beta(mean * both, (1.0 - mean) * both, size=count), 1.0)
