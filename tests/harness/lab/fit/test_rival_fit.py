"""The adaptive rival's deviations are found where they are known."""

import numpy as np
import pytest

from harness.lab.fit.rival_fit import with_deviation
from harness.lab.windows.cases import Cases
from mmpf.motion.idm import TREIBER_2000, Adaptation, AdaptiveDriver
from mmpf.motion.kinematic import ProcessNoise
from mmpf.motion.state import LON
from tests.mmpf.motion.surroundings import around, states, vehicle

STEP_S, COUNT = 0.1, 90
PLAIN = Adaptation(2.0, 0.0, 0.0)


def behind(state, step, hidden):
    """Return surroundings with a leader that drives on at 14 m/s."""
    ahead = vehicle(state.shape[1], 0.0, 14.0)
    ahead.gap_m[:] = 35.0 + 14.0 * STEP_S * step - state[LON]
    return around(state, ahead, hidden=hidden)


@pytest.mark.slow
@pytest.mark.parametrize(("size_mps2", "lasts_s"), [(0.4, 1.4), (1.8, 6.0)])
def test_drivers_that_deviate_so_far_are_found_to(size_mps2, lasts_s):
    rng = np.random.default_rng(1)
    model = AdaptiveDriver(TREIBER_2000, Adaptation(2.0, 0.0, 0.0, size_mps2, lasts_s), ProcessNoise(0.0, 0.0))
    truth = [states(COUNT, 14.0)]
    latents = model.draw_latents(truth[0], rng)
    for step in range(100):
        after, latents = model.propagate(truth[-1], latents, behind(truth[-1], step, True), STEP_S, rng)
        truth.append(after)
    found = with_deviation(TREIBER_2000, PLAIN, Cases(np.stack(truth), behind, np.arange(COUNT)))
    assert found.deviation_mps2 * np.sqrt(found.deviation_s) == pytest.approx(size_mps2 * np.sqrt(lasts_s), rel=0.35)
