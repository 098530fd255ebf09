"""The rivals with the process noise that was fitted for a study; see ``noise_fit``."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path

from mmpf.motion.idm import AdaptiveDriver, IdmParameters, intelligent_driver
from mmpf.motion.kinematic import STEPS, ProcessNoise, committed_table, kinematic
from mmpf.motion.protocol import MotionModel

FILE = Path(__file__).with_name("rival_noise.toml")


def rivals() -> dict[str, Callable[[ProcessNoise], MotionModel]]:
    """Return what makes each rival with a given noise."""
    kinematics: dict[str, Callable[[ProcessNoise], MotionModel]] = {
        name: lambda noise, name=name: kinematic(name, noise)  # type: ignore[misc]
        for name in STEPS
    }
    return kinematics | {
        "idm": lambda noise: intelligent_driver(noise=noise),
        "idm-fitted": lambda noise: intelligent_driver(
            IdmParameters(**committed_table("idm_fitted.toml")), noise, "idm-fitted"
        ),
        "idm-adaptive": lambda noise: AdaptiveDriver(noise=noise),
    }


def at_their_best(models: Mapping[str, MotionModel], study: str, file: Path = FILE) -> dict[str, MotionModel]:
    """Return a study's models, the rivals among them with the noise that was fitted for it under partial occlusion.

    Args:
        models: Models by name.
        study: Name of the study.
        file: Where the noise stands; models that it does not name stay as they are.
    """
    noise = tomllib.loads(file.read_text(encoding="utf-8")).get(study, {}) if file.exists() else {}
    make = rivals()
    return {
        name: make[name](ProcessNoise(**noise[name])) if name in make and name in noise else model
        for name, model in models.items()
    }
