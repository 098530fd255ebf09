"""Fits IDM and its adaptive form to the training windows, as rivals with the same data."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from harness.driving.cases import Cases, following_cases
from harness.driving.following import Following
from mmpf.compute.arrays import FloatArray
from mmpf.motion.idm import Adaptation, AdaptiveDriver, IdmParameters, intelligent_driver
from mmpf.motion.kinematic import ProcessNoise
from mmpf.motion.protocol import MotionModel
from mmpf.state import LON

WINDOWS = 300
GENERATIONS = 25
POPULATION = 8
HORIZONS_S = (1.0, 2.0, 5.0, 10.0)
DRIVER_BOUNDS = ((20.0, 45.0), (0.5, 2.5), (0.3, 3.0), (0.5, 5.0), (1.0, 5.0))
ADAPTATION_BOUNDS = ((0.5, 10.0), (-0.2, 1.0), (0.0, 1.0))
NO_NOISE = ProcessNoise(0.0, 0.0)

Adaptive = tuple[IdmParameters, Adaptation]


def fit_idm(windows: Following, seed: int, step_s: float) -> IdmParameters:
    """Fit IDM by differential evolution to the closed-loop position error, each horizon in proportion to its length.

    Args:
        windows: Training windows; those without a leader are left out.
        seed: Seed of the choice of windows and of the search.
        step_s: Time between steps.
    """
    found = _search(lambda values: intelligent_driver(_driver(values), NO_NOISE), DRIVER_BOUNDS, windows, seed, step_s)
    return _driver(found)


def fit_adaptive(windows: Following, seed: int, step_s: float) -> Adaptive:
    """Fit the adaptive form in the same way."""
    bounds = (*DRIVER_BOUNDS, *ADAPTATION_BOUNDS)
    return _adaptive(
        _search(lambda values: AdaptiveDriver(*_adaptive(values), NO_NOISE), bounds, windows, seed, step_s)
    )


def idm_toml(driver: IdmParameters) -> str:
    """Return the parameters as the committed file gives them."""
    return "\n".join(
        ["# Parameters of the intelligent driver model fitted to the training recordings.", *_lines(driver)]
    )


def adaptive_toml(fitted: Adaptive) -> str:
    """Return the adaptive form's parameters as the committed file gives them."""
    driver, adaptation = fitted
    head = "# Parameters of the adaptive intelligent driver model fitted to the training recordings."
    return "\n".join([head, "[driver]", *_lines(driver), "[adaptation]", *_lines(adaptation)])


def _lines(values: object) -> list[str]:
    return [*(f"{name} = {float(value):.4g}" for name, value in vars(values).items()), ""]


def _driver(values: FloatArray) -> IdmParameters:
    speed, headway, accel, decel, gap = (float(value) for value in values[:5])
    return IdmParameters(speed, headway, accel, decel, 4.0, gap)


def _adaptive(values: FloatArray) -> Adaptive:
    return _driver(values), Adaptation(*(float(value) for value in values[5:]))


def _search(
    model_of: Callable[[FloatArray], MotionModel],
    bounds: Sequence[tuple[float, float]],
    windows: Following,
    seed: int,
    step_s: float,
) -> FloatArray:
    from scipy.optimize import Bounds, differential_evolution  # noqa: PLC0415

    cases = following_cases(windows, WINDOWS, step_s, np.random.default_rng(seed))

    def error(values: FloatArray) -> float:
        return _closed_loop_error(model_of(values), cases)

    lowest, highest = np.transpose(bounds)
    found = differential_evolution(
        error,
        Bounds(lowest, highest),
        maxiter=GENERATIONS,
        popsize=POPULATION,
        rng=np.random.default_rng(seed),
        polish=False,
    )
    return np.asarray(found.x)


def _closed_loop_error(model: MotionModel, cases: Cases) -> float:
    rng = np.random.default_rng(0)
    state = cases.truth[0]
    latents = model.draw_latents(state, rng)
    scored = {round(horizon / cases.step_s): horizon for horizon in HORIZONS_S}
    error = 0.0
    for step in range(1, cases.steps):
        around = cases.surroundings(state, step - 1, True)
        state, latents = model.propagate(state, latents, around, cases.step_s, rng)
        if step in scored:
            error += float(np.abs(state[LON] - cases.truth[step, LON]).mean()) / scored[step]
    return error
