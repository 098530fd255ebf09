"""The size of the kinematic models' process noise, read from the committed table."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files


@dataclass(frozen=True)
class ProcessNoise:
    """White noise that drives a model, as root spectral densities.

    Attributes:
        lon: Along the road: m/s per root second where noise drives the speed, m/s² per root second where it drives
            the acceleration.
        lat: Across the road, likewise.
    """

    lon: float
    lat: float


@cache
def process_noise_table() -> dict[str, ProcessNoise]:
    """Return the committed noise of every kinematic model by its name."""
    text = files("mmpf.models").joinpath("process_noise.toml").read_text(encoding="utf-8")
    return {name: ProcessNoise(**sizes) for name, sizes in tomllib.loads(text).items()}


def process_noise(model: str) -> ProcessNoise:
    """Return the committed noise of one model."""
    return process_noise_table()[model]
