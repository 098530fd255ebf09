"""The learned drivers as model files."""

from __future__ import annotations

from dataclasses import astuple
from pathlib import Path

import numpy as np

from mmpf.motion import lane_changer, learned_driver, short_driver
from mmpf.motion.learned_driver import DriverModel
from mmpf.motion.model_file import mixture_arrays, save_arrays
from mmpf.motion.scaled_gmm import ScaledGmm


def save_driver(path: Path, model: DriverModel) -> None:
    """Write the learned driver's model file."""
    keeper = astuple(model.keeper)
    save_arrays(
        path,
        {
            f"case.{learned_driver.CASE}": np.ones(1),
            **mixture_arrays("following", model.following),
            **mixture_arrays("habit", model.habit),
            "free": np.array(astuple(model.free)),
            "lateral": np.array(keeper[:4]),
            "intention": np.array(keeper[4:]),
            "spread": np.array([model.accel_bias_mps2]),
        },
    )


def save_short(path: Path, mixture: ScaledGmm) -> None:
    """Write the short-term model's file."""
    save_arrays(path, {f"case.{short_driver.CASE}": np.ones(1), **mixture_arrays("joint", mixture)})


def save_change(path: Path, mixture: ScaledGmm) -> None:
    """Write the lane-change model's file."""
    save_arrays(path, {f"case.{lane_changer.CASE}": np.ones(1), **mixture_arrays("joint", mixture)})
