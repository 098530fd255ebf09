"""Whether a motion model from a file drives at all: it is tried where every driver's answer is roughly known.

The bounds are for any driver, not for a good one: a fraction of the braking that a situation demands, and more than the
accelerations and spreads of traffic. Drivers by the published parameters of IDM keep within them, too.
"""

from pathlib import Path

import numpy as np

from mmpf.motion.gmm.model_file import ModelFileError
from mmpf.motion.protocol import MotionModel, Neighbour, Surroundings, step_in_place
from mmpf.motion.state import ACCEL, LAT, LON, SPEED, STATE_SIZE
from mmpf.numerics.arrays import FloatArray

DRIVERS, STEPS, STEP_S, CAR_M, LANE_M, ALONE = 64, 20, 0.1, 4.6, 4.0, np.inf
LEAST_SPREAD_MPS, MOST_SPREAD_MPS, FURTHEST_ASIDE_M = 0.02, 3.0, 1.0
# Own speed and acceleration, gap and speed of the leader, speed that the road allows; least and greatest acceleration.
SITUATIONS = (
    (20.0, 0.0, ALONE, 0.0, np.inf, -1.5, 2.5),
    (30.0, 0.0, ALONE, 0.0, np.inf, -1.0, 2.0),
    (20.0, 2.0, ALONE, 0.0, np.inf, 0.0, 3.0),
    (25.0, 0.0, ALONE, 0.0, 15.0, -4.0, 2.5),
    (10.0, 0.0, 15.0, 10.0, np.inf, -1.0, 1.0),
    (20.0, -3.0, 30.0, 20.0, np.inf, -3.0, 0.5),
    (20.0, 0.0, 80.0, 20.0, np.inf, -1.0, 1.0),
    (30.0, 0.0, 45.0, 30.0, np.inf, -1.0, 1.0),
    (20.0, 0.0, 10.0, 20.0, np.inf, -2.0, 0.25),
    (20.0, 0.0, 30.0, 15.0, np.inf, -3.0, -0.15),
    (20.0, 0.0, 60.0, 10.0, np.inf, -3.0, -0.2),
    (25.0, 0.0, 80.0, 15.0, np.inf, -3.0, -0.2),
    (15.0, 0.0, 60.0, 25.0, np.inf, 0.0, 2.5),
)


def check_that_it_drives(motion: MotionModel, path: Path) -> None:
    """Try a model that was read from a file, without a draw from any run's stream.

    Raises:
        ModelFileError: Over two seconds it does what no driver does.
    """
    after = _two_seconds_later(motion)
    aside = np.sqrt(np.mean((after[LAT] - 0.5 * LANE_M) ** 2, axis=1))
    for row, speeds, away in zip(SITUATIONS, after[SPEED], aside, strict=True):
        speed, own, gap, leader, road, least, most = row
        gained, spread = (speeds.mean() - speed) / (STEPS * STEP_S), speeds.std()
        if not least <= gained <= most:
            said = f"it accelerates by {gained:.2f} m/s², where drivers do by {least:g} to {most:g}"
        elif not (LEAST_SPREAD_MPS <= spread <= MOST_SPREAD_MPS and away <= FURTHEST_ASIDE_M):
            said = f"after 2 s its speed is spread by {spread:.2g} m/s, and it is {away:.1f} m aside"
        else:
            continue
        where = "alone" if gap == ALONE else f"{gap:g} m behind a car at {leader:g} m/s"
        where += "" if road == np.inf else f" where the road allows {road:g} m/s"
        raise ModelFileError(f"model file {path}: no driver: at {speed:g} m/s and {own:g} m/s², {where}, {said}")


@np.errstate(all="ignore")
def _two_seconds_later(motion: MotionModel) -> FloatArray:
    """Return the states, shape (6, situations, drivers), of drivers out of sight in the middle of a lane."""
    speed, accel, gap, leader_speed, road, _, _ = np.repeat(np.array(SITUATIONS).T, DRIVERS, axis=1)
    state, no, zero, led = np.zeros((STATE_SIZE, len(gap))), gap < 0.0, np.zeros(len(gap)), gap < ALONE
    state[SPEED], state[ACCEL], state[LAT] = speed, accel, 0.5 * LANE_M
    rng, length = np.random.default_rng(0), zero + CAR_M
    latents = motion.draw_latents(state, rng)
    for step in range(STEPS):
        nobody = Neighbour(no, zero + np.inf, state[SPEED], zero, length)
        left, ahead = gap + step * STEP_S * leader_speed - state[LON], np.where(led, leader_speed, state[SPEED])
        others = Neighbour(led, left, ahead, zero, length), nobody, nobody, nobody, nobody
        around = Surroundings(length, zero, zero + LANE_M, ~no, ~no, *others, ~no, road)
        state = step_in_place(motion, state, latents, around, STEP_S, rng)
    return state.reshape(STATE_SIZE, len(SITUATIONS), DRIVERS)
