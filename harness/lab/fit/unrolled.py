"""Fits the residual follower to whole rollouts by their gradient.

Particles are rolled out behind recorded leaders for ten seconds. What is made small is the continuous ranked
probability score of their positions and speeds (Gneiting and Raftery, JASA 2007). It is a proper score: it is least
when particles are spread as vehicles are. Backpropagation through time is written out by hand: there are two layers
and three states.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from harness.lab.windows.car_following import CarFollowing
from mmpf.motion.learned import residual
from mmpf.motion.learned.features import FURTHEST_LEADER_M, SMALLEST_GAP_M, log_headway
from mmpf.motion.learned.residual import NetworkWeights
from mmpf.numerics.arrays import FloatArray, IntArray, taken

HIDDEN_UNITS = 16
ITERATIONS, WINDOWS, PARTICLES = 1200, 96, 8
LEARNING_RATE, WARM_UP = 0.015, 30
SCORED_STEPS = np.array([5, 10, 15, 20, 30, 40, 50, 65, 80, 100])
"""Steps that are scored, and how much: errors of position grow with about this power of time, those of speed less."""
POSITION_SCORE, SPEED_SCORE = (1.0, -1.3), (0.3, -0.5)
POSITION_WEIGHT, SPEED_WEIGHT = (f * (SCORED_STEPS * 0.1) ** power for f, power in (POSITION_SCORE, SPEED_SCORE))
# A tracker does not know leaders exactly, and some not at all: half of them are taken for somewhat different ones, and
# some are left out.
WRONG_SHARE, WRONG_GAP_M, WRONG_SPEED_MPS, WRONG_ACCEL_MPS2 = 0.5, 2.0, 0.5, 0.5
UNKNOWN_SHARE = 0.2
RANGE_QUANTILES = (0.0005, 0.9995)
DT = residual.FITTED_STEP_S

Array = npt.NDArray[np.floating]
Weights = dict[str, Array]
State = tuple[Array, Array, Array]
"""Places, speeds and accelerations of all particles, or a score's slopes by them, each of shape (n,)."""
WayBack = Callable[[Array, Array, Array, Weights], State]
"""From the slopes by the state after a step to those by the one before; adds those by the weights to a gradient."""


@dataclass(frozen=True)
class Rollouts:
    """Followers to roll out behind recorded leaders: b of them, p particles each, side by side.

    Attributes:
        led: Whether their leaders are known, shape (b * p,).
        leader_m: The leaders' rear ends ahead of the followers' fronts at the start, shape (steps, b * p).
        noise: Normal numbers, shape (steps, rows of noise, b * p).
        true_m: How far the followers really came, shape (steps, b).
    """

    speed_mps: Array
    accel_mps2: Array
    led: npt.NDArray[np.bool_]
    leader_m: Array
    leader_speed_mps: Array
    leader_accel_mps2: Array
    noise: Array
    true_m: Array
    true_speed_mps: Array


def fit_residual(
    windows: CarFollowing, seed: int, say: Callable[[str], None], iterations: int = ITERATIONS
) -> NetworkWeights:
    """Fit a network to windows of car following by Adam (Kingma and Ba, ICLR 2015)."""
    rng = np.random.default_rng(seed)
    scaling = scaling_of(windows.led)

    def minibatch_score(weights: Weights) -> tuple[float, Weights]:
        chosen = rng.choice(len(windows), size=min(WINDOWS, len(windows)), replace=False)
        return score_and_gradient(weights, scaling, rollouts_of(windows, chosen, PARTICLES, rng))

    weights = minimised_by_adam(initial_weights(rng, HIDDEN_UNITS), minibatch_score, iterations, say)
    network = scaling._replace(**{name: np.asarray(w, dtype=np.float32) for name, w in weights.items()})
    return network._replace(lag=sigmoid(network.lag).astype(np.float32))


def minimised_by_adam(
    weights: Weights,
    minibatch_score: Callable[[Weights], tuple[float, Weights]],
    iterations: int,
    say: Callable[[str], None],
) -> Weights:
    """Return weights of a lower score by Adam, given a function that scores a minibatch, with its gradient."""
    weights = dict(weights)
    slope, square = ({name: np.zeros_like(w) for name, w in weights.items()} for _ in range(2))
    smoothed = 0.0
    for step in range(1, iterations + 1):
        score, gradient = minibatch_score(weights)
        smoothed = score if step == 1 else 0.98 * smoothed + 0.02 * score
        if step % 200 == 0 or step == iterations:
            say(f"{step} of {iterations} steps, score {smoothed:.3f}")
        held = min(1.0, 1.0 / float(np.sqrt(sum((g**2).sum() for g in gradient.values()))))
        rate = LEARNING_RATE * min(1.0, step / WARM_UP) * 0.5 * (1.0 + np.cos(np.pi * step / (iterations + 1)))
        for name, g in gradient.items():
            slope[name] = 0.9 * slope[name] + 0.1 * held * g
            square[name] = 0.99 * square[name] + 0.01 * (held * g) ** 2
            change = slope[name] / (1.0 - 0.9**step) / (np.sqrt(square[name] / (1.0 - 0.99**step)) + 1e-8)
            weights[name] = (weights[name] - rate * change).astype(np.float32)
    return weights


def initial_weights(rng: np.random.Generator, hidden: int) -> Weights:
    """Return weights to begin with; the lag is kept as its logit."""
    sizes: dict[str, tuple[int, ...]] = {"w1": (residual.INPUTS, hidden), "b1": (hidden,), "w2": (hidden, hidden)}
    sizes |= {"b2": (hidden,), "w3": (hidden,), "b3": (1,)}
    scale = {"w1": residual.INPUTS**-0.5, "w2": hidden**-0.5, "w3": 0.1 * hidden**-0.5}
    drawn = {name: scale.get(name, 0.0) * rng.standard_normal(size) for name, size in sizes.items()}
    return {name: w.astype(np.float32) for name, w in (drawn | {"lag": np.array([-1.7])}).items()}


def scaling_of(led: CarFollowing) -> NetworkWeights:
    """Return a network that has nothing yet but the scaling of its inputs, given windows behind leaders."""
    headway = np.repeat(log_headway(led.gap_m[:, 0], led.speed_mps[:, 0]), led.gap_m.shape[1])
    columns = (np.log(np.maximum(led.gap_m, SMALLEST_GAP_M)), led.speed_mps, led.accel_mps2)
    leader = (led.speed_mps - led.leader.speed_mps, np.clip(led.leader.accel_mps2, *residual.STRONGEST_LEADER_MPS2))
    seen = np.stack([*(column.ravel() for column in (*columns, *leader)), headway])
    low, high = np.quantile(seen, RANGE_QUANTILES, axis=1)
    parts = (low, high, seen.mean(axis=1), seen.std(axis=1) + 1e-6)
    return NetworkWeights(*(part.astype(np.float32) for part in parts), *[np.zeros(1, dtype=np.float32)] * 7)


def rollouts_of(windows: CarFollowing, chosen: IntArray, particles: int, rng: np.random.Generator) -> Rollouts:
    """Return rollouts of the windows ``chosen``, many of them with leaders that are not quite the true ones."""

    def particles_of(column: FloatArray) -> Array:
        return np.repeat(np.ascontiguousarray(column.T, dtype=np.float32), particles, axis=-1)

    here = taken(windows, chosen)
    led = here.has_leader & (rng.random(len(chosen)) >= UNKNOWN_SHARE)
    ahead = np.nan_to_num(here.gap_m + here.lon_m - here.lon_m[:, :1])
    spread = (rng.random(len(chosen)) < WRONG_SHARE) * np.exp(0.5 * rng.standard_normal(len(chosen)))
    gap, speed, accel = spread * rng.standard_normal((3, len(chosen)))
    leader_m = ahead + np.maximum(WRONG_GAP_M * gap, -0.5 * np.maximum(ahead[:, 0], 0.0))[:, None]
    leader_speed = np.nan_to_num(here.leader.speed_mps) + WRONG_SPEED_MPS * speed[:, None]
    leader_accel = np.nan_to_num(here.leader.accel_mps2) + WRONG_ACCEL_MPS2 * accel[:, None]
    size = ahead.shape[1], len(residual.TIME_SCALES_S), len(chosen) * particles
    return Rollouts(
        speed_mps=particles_of(here.speed_mps[:, 0]),
        accel_mps2=particles_of(here.accel_mps2[:, 0]),
        led=np.repeat(led, particles),
        leader_m=particles_of(leader_m),
        leader_speed_mps=particles_of(leader_speed),
        leader_accel_mps2=particles_of(np.clip(leader_accel, *residual.STRONGEST_LEADER_MPS2)),
        noise=rng.standard_normal(size, dtype=np.float32),
        true_m=(here.lon_m - here.lon_m[:, :1]).T,
        true_speed_mps=here.speed_mps.T,
    )


def score_and_gradient(weights: Weights, scaling: NetworkWeights, rollouts: Rollouts) -> tuple[float, Weights]:
    """Return the score of the particles and its gradient with respect to the weights, of which the lag is a logit."""
    place, speed, ways_back = _roll(weights, scaling, rollouts)
    steps = SCORED_STEPS[len(place) > SCORED_STEPS]
    by_place, by_speed = np.zeros_like(place), np.zeros_like(speed)
    score = 0.0
    for values, true, weight, slope in (
        (place, rollouts.true_m, POSITION_WEIGHT, by_place),
        (speed, rollouts.true_speed_mps, SPEED_WEIGHT, by_speed),
    ):
        some = weight[: len(steps), None]
        crps, crps_slope = crps_and_slope(values[steps], true[steps])
        score += float((some * crps).sum())
        slope[steps] = some * crps_slope
    gradient: Weights = {name: np.zeros(w.shape) for name, w in weights.items()}
    slopes = by_place[-1], by_speed[-1], np.zeros_like(by_place[-1])
    for back, by_place_here, by_speed_here in zip(ways_back[::-1], by_place[-2::-1], by_speed[-2::-1], strict=True):
        before = back(*slopes, gradient)
        slopes = before[0] + by_place_here, before[1] + by_speed_here, before[2]
    return score, gradient


def crps_and_slope(particles: Array, true: Array) -> tuple[FloatArray, FloatArray]:
    """Return the score of equally weighted particles, mean over b cases, without the bias of few, and its slope.

    Args:
        particles: p of each case side by side, shape (k, b * p).

    Returns:
        The score, shape (k, 1), and its slope with respect to each particle, shape (k, b * p).
    """
    k, cases = true.shape
    each = particles.reshape(k, cases, -1).astype(np.float64)
    count = each.shape[2]
    away, apart = each - true[:, :, None], each[:, :, :, None] - each[:, :, None, :]
    score = np.abs(away).mean(axis=2) - np.abs(apart).sum(axis=(2, 3)) / (2 * count * (count - 1))
    slope = (np.sign(away) - np.sign(apart).sum(axis=3) / (count - 1)) / (count * cases)
    return score.mean(axis=1, keepdims=True), slope.reshape(k, -1)


def sigmoid(logit: Array) -> Array:
    """Return the share, from 0 to 1, that a logit stands for."""
    return np.asarray(1.0 / (1.0 + np.exp(-logit)))


def _softsign(x: Array) -> tuple[Array, Array]:
    beyond = 1.0 + np.abs(x)
    return x / beyond, 1.0 / beyond**2


def _usual(gap: Array, speed: Array, leader_speed: Array, led: npt.NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Return what the usual driver does by IDM, and its slopes by gap and speed."""
    driver = residual.USUAL_DRIVER
    braking = 2.0 * np.sqrt(driver.max_accel_mps2 * driver.comfortable_decel_mps2)
    dynamic = speed * (driver.time_headway_s + (speed - leader_speed) / braking)
    wanted = driver.standstill_gap_m + np.maximum(dynamic, 0.0)
    free = (speed / driver.desired_speed_mps) ** 4
    accel = driver.max_accel_mps2 * (1.0 - free - (wanted / gap) ** 2)
    low, high = residual.IDM_RANGE_MPS2
    counts = (accel > low) & (accel < high)
    more = np.where(dynamic > 0.0, driver.time_headway_s + led * (2.0 * speed - leader_speed) / braking, 0.0)
    by_speed = -driver.max_accel_mps2 * (4.0 * speed**3 / driver.desired_speed_mps**4 + 2.0 * wanted / gap**2 * more)
    by_gap = 2.0 * driver.max_accel_mps2 * wanted**2 / gap**3
    return np.clip(accel, low, high), counts * by_gap, counts * by_speed


def _roll(weights: Weights, scaling: NetworkWeights, rollouts: Rollouts) -> tuple[Array, Array, list[WayBack]]:
    """Return places and speeds of all particles, shape (steps, n), and the way back of each step but the last."""
    state = np.zeros_like(rollouts.speed_mps), rollouts.speed_mps, rollouts.accel_mps2
    noise, states, ways_back = rollouts.noise[0], [state], []
    headway = log_headway(np.asarray(rollouts.leader_m[0], dtype=np.float64), np.asarray(state[1], dtype=np.float64))
    headway = np.where(rollouts.led, headway, scaling.mean[-1])
    lasts = np.exp(-DT / np.array(residual.TIME_SCALES_S))[:, None]
    for step in range(len(rollouts.leader_m) - 1):
        state, back = _stepped(weights, scaling, rollouts, step, state, headway, noise)
        states.append(state)
        ways_back.append(back)
        noise = lasts * noise + np.sqrt(1.0 - lasts**2) * rollouts.noise[step + 1]
    places, speeds, _ = zip(*states, strict=True)
    return np.stack(places), np.stack(speeds), ways_back


def _stepped(
    weights: Weights, scaling: NetworkWeights, rollouts: Rollouts, step: int, state: State, headway: Array, noise: Array
) -> tuple[State, WayBack]:
    """Return the particles after a step, and its way back."""
    place, speed, accel = state
    led, lag = rollouts.led, sigmoid(weights["lag"])[0]
    low, high, mean, scale = (part[:, None] for part in scaling[:4])
    distance = np.where(led, rollouts.leader_m[step] - place, FURTHEST_LEADER_M)
    gap, leader_speed = np.maximum(distance, SMALLEST_GAP_M), np.where(led, rollouts.leader_speed_mps[step], speed)
    leader_accel = np.where(led, rollouts.leader_accel_mps2[step], 0.0)
    seen = np.stack([np.log(gap), speed, accel, speed - leader_speed, leader_accel, headway])
    inputs = np.concatenate([(np.clip(seen, low, high) - mean) / scale, noise]).astype(speed.dtype)
    first, first_slope = _softsign(weights["w1"].T @ inputs + weights["b1"][:, None])
    second, second_slope = _softsign(weights["w2"].T @ first + weights["b2"][:, None])
    usual, usual_by_gap, usual_by_speed = _usual(gap, speed, leader_speed, led)
    pull = usual + weights["w3"] @ second + weights["b3"][0] - accel
    next_speed = speed + DT * (accel + lag * pull)
    moves = next_speed > 0.0
    next_speed = np.where(moves, next_speed, 0.0).astype(speed.dtype)
    next_accel = np.where(moves, accel + lag * pull, 0.0).astype(speed.dtype)
    next_place = (place + 0.5 * DT * (speed + next_speed)).astype(speed.dtype)

    def back(by_place: Array, by_speed: Array, by_accel: Array, gradient: Weights) -> State:
        by_next_speed = (by_speed + 0.5 * DT * by_place) * moves
        by_next_accel = by_accel * moves + DT * by_next_speed
        by_wanted = lag * by_next_accel
        gradient["lag"] += np.sum(pull * by_next_accel) * lag * (1.0 - lag)
        gradient["b3"] += by_wanted.sum()
        gradient["w3"] += second @ by_wanted
        by_second = weights["w3"][:, None] * by_wanted * second_slope
        gradient["w2"] += first @ by_second.T
        gradient["b2"] += by_second.sum(axis=1)
        by_first = (weights["w2"] @ by_second) * first_slope
        gradient["w1"] += inputs @ by_first.T
        gradient["b1"] += by_first.sum(axis=1)
        states = residual.SEEN - 2
        within = (seen[:states] > low[:states]) & (seen[:states] < high[:states])
        within[3] &= led
        by_seen = (weights["w1"][:states] @ by_first) / scale[:states] * within
        near = (distance > SMALLEST_GAP_M) & led
        by_gap = by_seen[0] * (near / gap) + by_wanted * (near * usual_by_gap)
        by_speed = 0.5 * DT * by_place + by_next_speed + by_seen[1] + by_seen[3] + by_wanted * usual_by_speed
        return by_place - by_gap, by_speed, (1.0 - lag) * by_next_accel + by_seen[2]

    return (next_place, next_speed, next_accel), back
