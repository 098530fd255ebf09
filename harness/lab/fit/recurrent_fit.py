"""Fits the recurrent follower to whole rollouts, by JAX's gradient through them; needs the extra ``deep``.

As for the residual follower (``unrolled``) what is made small is the continuous ranked probability score of particles
behind recorded leaders. Here many of them first go for some seconds through what was recorded, as a vehicle in sight
takes its particles along, so that the network learns what a memory of it is worth.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from harness.common.errors import InputError
from harness.lab.fit import unrolled
from harness.lab.fit.unrolled import PARTICLES, Array, Weights
from harness.lab.windows.car_following import CarFollowing
from mmpf.motion.learned.features import FURTHEST_LEADER_M, SITUATION_SIZE, SMALLEST_GAP_M
from mmpf.motion.learned.recurrent import NOISE, OUTPUTS, RecurrentWeights
from mmpf.motion.learned.residual import FITTED_STEP_S, IDM_RANGE_MPS2, TIME_SCALES_S, USUAL_DRIVER
from mmpf.numerics.arrays import IntArray

UNITS = 16
ITERATIONS = 1500
DT = FITTED_STEP_S
SEEN_STEPS = (0, 0, 10, 25, 50)
"""How many steps a window goes through what was recorded before its particles are on their own: one of these."""
SEEN_STDS = np.array([0.2, 0.2, 0.4])
"""Standard deviations of how far particles of a vehicle in sight are from what was recorded: m, m/s and m/s²."""
SCORED_EVERY = 5

Inputs: TypeAlias = dict[str, Array]
Traced: TypeAlias = Any
"""An array of JAX, which has no types where it is not installed."""


def fit_recurrent(
    windows: CarFollowing, seed: int, say: Callable[[str], None], iterations: int = ITERATIONS
) -> RecurrentWeights:
    """Fit a network to windows of 10 s, with and without leaders, by Adam.

    Raises:
        InputError: JAX is not installed.
    """
    rng = np.random.default_rng(seed)
    scaling = unrolled.scaling_of(windows.led)
    parts = [part[:SITUATION_SIZE] for part in scaling[:4]]
    score_and_gradient = compiled_score(*parts)

    def minibatch_score(weights: Weights) -> tuple[float, Weights]:
        chosen = rng.choice(len(windows), size=min(unrolled.WINDOWS, len(windows)), replace=False)
        score, gradient = score_and_gradient(weights, drawn_inputs(windows, chosen, rng))
        return float(score), {name: np.asarray(g) for name, g in gradient.items()}

    weights = unrolled.minimised_by_adam(initial_weights(rng, UNITS), minibatch_score, iterations, say)
    return network_of(parts, weights)


def network_of(scaling: Sequence[Array], weights: Weights) -> RecurrentWeights:
    """Return the network of four rows of scaling and weights by name, of which the lag is a logit."""
    values = weights | {"lag": unrolled.sigmoid(weights["lag"])}
    return RecurrentWeights(*scaling, **{name: np.asarray(w, dtype=np.float32) for name, w in values.items()})


def initial_weights(rng: np.random.Generator, units: int) -> Weights:
    """Return weights to begin with: memories last for a second or so, noise is small; the lag is kept as its logit."""
    gates = 3 * units
    weights = {
        "w": SITUATION_SIZE**-0.5 * rng.standard_normal((SITUATION_SIZE, gates)),
        "b": np.repeat([-2.0, 1.0, 0.0], units),
        "u": units**-0.5 * rng.standard_normal((units, gates)),
        "c": np.zeros(units),
        "out": 0.1 * units**-0.5 * rng.standard_normal((units, OUTPUTS)),
        "shift": np.array([0.0, *[-2.0] * NOISE]),
        "lag": np.array([-1.7]),
    }
    return {name: w.astype(np.float32) for name, w in weights.items()}


def drawn_inputs(windows: CarFollowing, chosen: IntArray, rng: np.random.Generator) -> Inputs:
    """Return what ``compiled_score`` needs of the windows ``chosen``: b windows, p particles each, over time."""
    rollouts = unrolled.rollouts_of(windows, chosen, PARTICLES, rng)
    steps, count = rollouts.leader_m.shape
    scatter = rng.standard_normal((3, steps, count)).swapaxes(0, 1)
    seen_steps = rng.choice(SEEN_STEPS, size=len(chosen))
    alone_from = np.repeat(seen_steps, PARTICLES)
    true = np.stack([rollouts.true_m, rollouts.true_speed_mps, windows.accel_mps2[chosen].T], axis=1)
    recorded = np.repeat(true, PARTICLES, axis=2) + SEEN_STDS[:, None] * scatter
    # Those that nobody saw before begin exactly where the vehicle was.
    start = np.stack([np.zeros(count), rollouts.speed_mps, rollouts.accel_mps2])
    recorded[0] = np.where(alone_from == 0, start, recorded[0])
    recorded[:, 1] = np.maximum(recorded[:, 1], 0.0)
    inputs = {
        "led": rollouts.led,
        "leader": np.stack([rollouts.leader_m, rollouts.leader_speed_mps, rollouts.leader_accel_mps2], axis=1),
        "noise": rollouts.noise,
        "true_m": rollouts.true_m,
        "true_speed_mps": rollouts.true_speed_mps,
        "recorded": recorded,
        "alone_from": alone_from,
    }
    steps_alone = np.arange(steps)[:, None] - seen_steps
    scored = (steps_alone > 0) & (steps_alone % SCORED_EVERY == 0)
    seconds = np.where(scored, steps_alone, 1) * DT
    for name, (factor, power) in {"m": unrolled.POSITION_SCORE, "mps": unrolled.SPEED_SCORE}.items():
        # As often as a step is scored in the other fit, at its weight.
        inputs[f"weight_{name}"] = scored * factor * seconds**power / len(chosen)
    return {name: v if v.dtype == np.bool_ else np.asarray(v, dtype=np.float32) for name, v in inputs.items()}


def compiled_score(
    low: Array, high: Array, mean: Array, scale: Array
) -> Callable[[Weights, Inputs], tuple[Traced, dict[str, Traced]]]:
    """Return a function of weights and inputs that gives the score and its gradient by the weights.

    Least and greatest situation, their means and their standard deviations are each of shape (5,).
    """
    try:
        import jax  # noqa: PLC0415  an extra that only this fit needs
    except ImportError as error:
        raise InputError("`case` recurrent: JAX is not installed: pip install -c constraints.txt '.[deep]'") from error
    jnp = jax.numpy
    lows, highs, means, scales = (np.asarray(part)[:, None] for part in (low, high, mean, scale))
    lasts = np.exp(-DT / np.array(TIME_SCALES_S))[:, None].astype(np.float32)
    driver = USUAL_DRIVER
    braking = float(2.0 * np.sqrt(driver.max_accel_mps2 * driver.comfortable_decel_mps2))

    def usual(gap: Traced, speed: Traced, closing: Traced) -> Traced:
        wanted = driver.standstill_gap_m + jnp.maximum(speed * (driver.time_headway_s + closing / braking), 0.0)
        free = (speed / driver.desired_speed_mps) ** 4
        return jnp.clip(driver.max_accel_mps2 * (1.0 - free - (wanted / gap) ** 2), *IDM_RANGE_MPS2)

    def score(weights: dict[str, Traced], inputs: dict[str, Traced]) -> Traced:
        units, led = len(weights["c"]), inputs["led"]
        lag = jax.nn.sigmoid(weights["lag"][0])

        def step(carried: tuple[Traced, ...], now: tuple[Traced, ...]) -> tuple[tuple[Traced, ...], tuple[Traced, ...]]:
            place, speed, accel, memory, noise = carried
            number, leader, recorded, fresh = now
            seen = number <= inputs["alone_from"]
            place, speed, accel = (
                jnp.where(seen, r, own) for r, own in zip(recorded, (place, speed, accel), strict=True)
            )
            gap = jnp.maximum(jnp.where(led, leader[0] - place, FURTHEST_LEADER_M), SMALLEST_GAP_M)
            closing = jnp.where(led, speed - leader[1], 0.0)
            situation = jnp.stack([jnp.log(gap), speed, accel, closing, jnp.where(led, leader[2], 0.0)])
            standard = (jnp.clip(situation, lows, highs) - means) / scales
            sums = weights["w"].T @ standard + weights["b"][:, None]
            known = weights["u"].T @ memory
            update = 0.5 * (1.0 + _softsign(sums[:units] + known[:units]))
            reset = 0.5 * (1.0 + _softsign(sums[units : 2 * units] + known[units : 2 * units]))
            new = _softsign(sums[2 * units :] + reset * (known[2 * units :] + weights["c"][:, None]))
            memory = memory + update * (new - memory)
            said = weights["out"].T @ memory + weights["shift"][:, None]
            factor = jnp.where(said[1:] > 0.0, 1.0 + said[1:], 1.0 / (1.0 + jnp.abs(said[1:])))
            wanted = usual(gap, speed, closing) + said[0] + (factor * noise).sum(axis=0)
            after = accel + lag * (wanted - accel)
            next_speed = speed + DT * after
            moves = next_speed > 0.0
            next_speed = jnp.where(moves, next_speed, 0.0)
            place = place + 0.5 * DT * (speed + next_speed)
            noise = lasts * noise + jnp.sqrt(1.0 - lasts**2) * fresh
            return (place, next_speed, jnp.where(moves, after, 0.0), memory, noise), (place, next_speed)

        steps, count = len(inputs["leader"]), led.shape[0]
        first = (*inputs["recorded"][0], jnp.zeros((units, count)), inputs["noise"][0])
        moments = (jnp.arange(steps - 1), inputs["leader"][:-1], inputs["recorded"][:-1], inputs["noise"][1:])
        _, rolled = jax.lax.scan(step, first, moments)
        total = jnp.zeros(())
        for values, true, weight in zip(rolled, ("true_m", "true_speed_mps"), ("weight_m", "weight_mps"), strict=True):
            total += (inputs[weight][1:] * _crps(values, inputs[true][1:])).sum()
        return total

    compiled: Callable[[Weights, Inputs], tuple[Traced, dict[str, Traced]]] = jax.jit(jax.value_and_grad(score))
    return compiled


def _softsign(x: Traced) -> Traced:
    return x / (1.0 + abs(x))


def _crps(particles: Traced, true: Traced) -> Traced:
    """Return the score without the bias of few, shape (k, b), of the particles of b cases side by side, (k, b * p)."""
    each = particles.reshape(*true.shape, PARTICLES)
    apart = abs(each[..., :, None] - each[..., None, :]).sum(axis=(-2, -1))
    return abs(each - true[..., None]).mean(axis=-1) - apart / (2 * PARTICLES * (PARTICLES - 1))
