"""Fits the rivals' process noise for each study, so that none loses by noise that was fitted for something else.

    python -m harness.lab.study.noise_fit --write

Under partial occlusion a model is the prediction of a filter, and the noise with which it filters best is not the one
with which it foretells best. For each study and rival the committed noise is scaled along the road and across it, each
by the factor with the smallest error over all steps: of the position along the road, and of the lateral speed. Traffic
comes from tuning seeds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace

import numpy as np

from harness.common.files import write_toml
from harness.lab.study.published import MODELS, StudyPlan, cases_of_plan
from harness.lab.study.rival_noise import FILE, rivals
from harness.lab.windows.cases import Cases
from harness.lab.windows.filtering import MeasurementNoise, follow, measure
from harness.lab.windows.scenarios import FIRST_TUNING_SEED
from harness.lab.windows.scores import score
from harness.truth.network.network import load_network
from mmpf.motion.kinematic import ProcessNoise, process_noise
from mmpf.motion.protocol import MotionModel

FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
CASES, PARTICLES, RECORDINGS = 120, 300, 8
COMMENT = """\
Process noise of each rival under partial occlusion, by study: the committed one of mmpf/models/process_noise.toml,
scaled by the factors with the smallest error on tuning seeds. Made by python -m harness.lab.study.noise_fit --write."""


def fit_noise(name: str, cases: Cases, particles: int = PARTICLES) -> ProcessNoise:
    """Return the noise with which a rival filters best.

    Args:
        name: Name of the rival.
        cases: Cases on tuning seeds, seen through the studies' partial occlusion.
        particles: Particles per case.
    """
    best = process_noise(name)
    for side, quantity in (("lon", "lon_m"), ("lat", "lat_speed_mps")):
        base = getattr(best, side)
        tried = [replace(best, **{side: factor * base}) for factor in FACTORS]
        errors = [_error(rivals()[name](noise), cases, quantity, particles) for noise in tried]
        best = tried[int(np.argmin(errors))]
    return best


def _error(model: MotionModel, cases: Cases, quantity: str, particles: int) -> float:
    noise = MeasurementNoise()
    measurements = measure(cases, noise, np.random.default_rng([0, 1]))
    clouds = follow(model, cases, particles, np.random.default_rng([0, 2]), measurements, noise)
    return float(score(clouds, cases).abs_error[quantity].mean())


def fit_study(names: Sequence[str], cases: Cases, say: Callable[[str], None]) -> dict[str, dict[str, float]]:
    """Return the noise of each rival among a study's models, by name."""
    fitted = {}
    for name in names:
        if name in rivals():
            before, after = process_noise(name), fit_noise(name, cases)
            say(f"{name}: lon {before.lon:g} -> {after.lon:g}, lat {before.lat:g} -> {after.lat:g}")
            fitted[name] = {side: float(f"{value:.4g}") for side, value in asdict(after).items()}
    return fitted


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit all rivals of all studies."""
    parser = argparse.ArgumentParser(prog="python -m harness.lab.study.noise_fit", description="Fit the rivals' noise.")
    parser.add_argument("--write", action="store_true", help=f"put the outcome into {FILE.name}")
    chosen = parser.parse_args(arguments)

    def say(line: str) -> None:
        sys.stderr.write(f"{line}\n")

    fitted = {}
    for study, names in MODELS.items():
        plan = StudyPlan(study, cases=CASES, first_traffic_seed=FIRST_TUNING_SEED, recordings=RECORDINGS)
        fitted[study] = fit_study(names, cases_of_plan(plan, load_network("us101"), say), say)
    if chosen.write:
        write_toml(FILE, fitted, COMMENT)


if __name__ == "__main__":
    main()
