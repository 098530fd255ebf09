"""Fits the other models to the same data: IDM, its adaptive form, and the process noise of kinematic models.

The size of the noise is found by one procedure for all: maximum likelihood of the state one second on. Each model runs
without noise from recorded states for one second. Its errors in position and speed are taken for those of white noise
driving the speed (CVM, CSAV, IDM) or the acceleration (CAM, CSAA), integrated over the second; the likelihood's maximum
over the noise's spectral density is then ``mean(e' Q^-1 e) / 2`` with Q for unit density.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
from scipy.optimize import Bounds, differential_evolution

from harness.common.files import write_toml
from harness.lab.fit.card import TRAFFIC
from harness.lab.windows.car_following import CarFollowing
from harness.lab.windows.cases import Cases, following_cases
from harness.lab.windows.filtering import HORIZONS_S, follow, score
from harness.truth.frame import STEP_S
from mmpf.motion.idm import Adaptation, AdaptiveDriver, IdmParameters, intelligent_driver
from mmpf.motion.kinematic import ProcessNoise, kinematic
from mmpf.motion.protocol import MotionModel
from mmpf.motion.state import LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray

WINDOWS = 300
GENERATIONS = 25
POPULATION = 8
DRIVER_BOUNDS = ((20.0, 45.0), (0.5, 2.5), (0.3, 3.0), (0.5, 5.0), (1.0, 5.0))
ADAPTATION_BOUNDS = ((0.5, 10.0), (-0.2, 1.0), (0.0, 1.0))
DEVIATION_PARTICLES = 50
DEVIATIONS = tuple((size_mps2, lasts_s) for size_mps2 in (0.4, 0.7, 1.0, 1.4, 1.8) for lasts_s in (1.4, 3.0, 6.0))
"""What is tried: how far drivers deviate from the model, and for how long."""
NO_NOISE = ProcessNoise(0.0, 0.0)
AHEAD_S = 1.0
SPEED_DRIVEN = np.array([[1.0 / 3.0, 0.5], [0.5, 1.0]])
ACCEL_DRIVEN = np.array([[1.0 / 20.0, 1.0 / 8.0], [1.0 / 8.0, 1.0 / 3.0]])
IDM_COMMENT = "Parameters of the intelligent driver model fitted to the training recordings."
ADAPTIVE_COMMENT = "Parameters of the adaptive intelligent driver model fitted to the training recordings."
NOISE_COMMENT = """\
Root spectral density of the white noise that drives each model: acceleration (m/s^2 per root second)
for cam, csaa and csav across the road, speed (m/s per root second) for all others.
Found by maximum likelihood of the state one second on, over the tuning seeds."""

Adaptive = tuple[IdmParameters, Adaptation]


def fit_idm(windows: CarFollowing, seed: int) -> IdmParameters:
    """Fit IDM by differential evolution to the closed-loop position error, each horizon in proportion to its length.

    Windows without a leader are left out.
    """
    found = _search(lambda values: intelligent_driver(_driver(values), NO_NOISE), DRIVER_BOUNDS, windows, seed)
    return _driver(found)


def fit_adaptive(windows: CarFollowing, seed: int) -> Adaptive:
    """Fit the adaptive form in the same way, and how long and how far drivers deviate from it."""
    bounds = (*DRIVER_BOUNDS, *ADAPTATION_BOUNDS)
    found = _search(lambda values: AdaptiveDriver(*_adaptive(values), NO_NOISE), bounds, windows, seed)
    driver, adaptation = _adaptive(found)
    cases = following_cases(windows, WINDOWS, np.random.default_rng(seed))
    return driver, with_deviation(driver, adaptation, cases)


def with_deviation(driver: IdmParameters, adaptation: Adaptation, cases: Cases) -> Adaptation:
    """Return the adaptation with those of ``DEVIATIONS`` that predict the cases best, by the score of all particles."""

    def crps(deviation: tuple[float, float]) -> float:
        model = AdaptiveDriver(driver, _deviating(adaptation, deviation), NO_NOISE)
        scores = score(follow(model, cases, DEVIATION_PARTICLES, np.random.default_rng(0)), cases)
        return sum(float(scores.crps_m[round(ahead / STEP_S) - 1].mean()) / ahead for ahead in HORIZONS_S)

    return _deviating(adaptation, min(DEVIATIONS, key=crps))


def _deviating(adaptation: Adaptation, deviation: tuple[float, float]) -> Adaptation:
    return replace(adaptation, deviation_mps2=deviation[0], deviation_s=deviation[1])


def fit_noise(traffic: Sequence[Cases], fitted: IdmParameters, adaptive: Adaptive) -> dict[str, ProcessNoise]:
    """Return the noise of each kinematic model in lane keeping and lane changes, each as often as it happens."""
    fitted_driver, adaptation = adaptive
    rivals: tuple[tuple[MotionModel, FloatArray, FloatArray], ...] = (
        (kinematic("cvm", NO_NOISE), SPEED_DRIVEN, SPEED_DRIVEN),
        (kinematic("cam", NO_NOISE), ACCEL_DRIVEN, ACCEL_DRIVEN),
        (kinematic("csav", NO_NOISE), SPEED_DRIVEN, ACCEL_DRIVEN),
        (kinematic("csaa", NO_NOISE), ACCEL_DRIVEN, ACCEL_DRIVEN),
        (intelligent_driver(noise=NO_NOISE), SPEED_DRIVEN, SPEED_DRIVEN),
        (intelligent_driver(fitted, NO_NOISE, "idm-fitted"), SPEED_DRIVEN, SPEED_DRIVEN),
        (AdaptiveDriver(fitted_driver, replace(adaptation, deviation_mps2=0.0), NO_NOISE), SPEED_DRIVEN, SPEED_DRIVEN),
    )
    found = {}
    for model, lon, lat in rivals:
        away = np.concatenate([_errors(model, cases) for cases in traffic], axis=1)
        found[model.name] = ProcessNoise(_density(away[:2], lon), _density(away[2:], lat))
    # Its deviations take the place of white noise along the road.
    return found | {"idm-adaptive": replace(found["idm-adaptive"], lon=0.0)}


def write_rivals(
    folder: Path, driver: IdmParameters, adaptive: Adaptive, noise: Mapping[str, ProcessNoise], traffic: str
) -> None:
    """Write the three files that the models read, four digits of every number; ``traffic`` is what was fitted to."""
    source = f"\n{TRAFFIC}: {traffic}"
    fitted, adaptation = adaptive
    write_toml(folder / "idm_fitted.toml", _four_digits(driver), IDM_COMMENT + source)
    tables = {"driver": _four_digits(fitted), "adaptation": _four_digits(adaptation)}
    write_toml(folder / "idm_adaptive.toml", tables, ADAPTIVE_COMMENT + source)
    sizes = {name: _four_digits(size) for name, size in noise.items()}
    write_toml(folder / "process_noise.toml", sizes, NOISE_COMMENT + source)


def _four_digits(parameters: object) -> dict[str, float]:
    return {name: float(f"{value:.4g}") for name, value in vars(parameters).items()}


def _driver(values: FloatArray) -> IdmParameters:
    speed, headway, accel, decel, gap = (float(value) for value in values[:5])
    return IdmParameters(speed, headway, accel, decel, 4.0, gap)


def _adaptive(values: FloatArray) -> Adaptive:
    return _driver(values), Adaptation(*(float(value) for value in values[5:]))


def _search(
    model_of: Callable[[FloatArray], MotionModel],
    bounds: Sequence[tuple[float, float]],
    windows: CarFollowing,
    seed: int,
) -> FloatArray:
    cases = following_cases(windows, WINDOWS, np.random.default_rng(seed))

    scored = {round(horizon / STEP_S): horizon for horizon in HORIZONS_S}

    def error(values: FloatArray) -> float:
        states = ((step, state) for step, state in _rolled_out(model_of(values), cases) if step in scored)
        return sum(float(np.abs(state[LON] - cases.truth[step, LON]).mean()) / scored[step] for step, state in states)

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


def _rolled_out(model: MotionModel, cases: Cases, start: int = 0) -> Iterator[tuple[int, FloatArray]]:
    """Yield each later step with the states there, shape (6, m), of one particle a case that begins at the truth."""
    rng = np.random.default_rng(0)
    state = cases.truth[start]
    latents = model.draw_latents(state, rng)
    for step in range(start + 1, cases.steps):
        state, latents = model.propagate(state, latents, cases.surroundings(state, step - 1, True), STEP_S, rng)
        yield step, state


def _errors(model: MotionModel, cases: Cases) -> FloatArray:
    """Return errors in longitudinal position and speed, lateral position and speed, of all seconds: shape (4, n)."""
    ahead = round(AHEAD_S / STEP_S)
    starts = range(0, cases.steps - ahead, ahead)
    ends = [next(islice(_rolled_out(model, cases, start), ahead - 1, None)) for start in starts]
    return np.concatenate([(state - cases.truth[end])[[LON, SPEED, LAT, LAT_SPEED]] for end, state in ends], axis=1)


def _density(errors: FloatArray, shape: FloatArray) -> float:
    return float(np.sqrt(np.einsum("in,ij,jn->n", errors, np.linalg.inv(shape), errors).mean() / 2.0))
