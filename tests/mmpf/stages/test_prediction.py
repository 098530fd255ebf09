"""The noise that the filter adds to a motion model's prediction."""

import numpy as np
import pytest

from mmpf.belief.birth import Traffic
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion import motion_model
from mmpf.motion.protocol import MotionModel, MotionModelFactory, Surroundings, motion_models, spreads_speed
from mmpf.motion.state import SPEED
from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import FilterOptions
from mmpf.registry import Registry
from mmpf.scan import SensorModel
from mmpf.stages.prediction import bootstrap_proposal, prior_update
from mmpf.stages.update_rule import Situation
from mmpf.tracker import MixtureTracker
from tests.mmpf.motion.surroundings import around
from tests.mmpf.scenes import ROAD, LinearGaussianMotion, lane_centre, scan_of

NAMES = ["gmm", "cvm", "my-own"]


class Still(LinearGaussianMotion):
    """A user's own model, which says nothing of how it spreads the speed: no particle ever moves."""

    def propagate(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        return state.copy(), latents


class StillThatSpreads(Still):
    """The same, but it says that its speeds come apart by themselves."""

    spreads_speed = True


class StillThatDoesNotSpread(Still):
    """The same, but it says that they do not."""

    spreads_speed = False


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("model", "update", "expected"),
    [
        (StillThatSpreads, "joint", 0.0),
        (StillThatSpreads, "max_likelihood", 0.4),
        (StillThatDoesNotSpread, "joint", 0.4),
        (Still, "joint", 0.4),
        (Still, "max_likelihood", 0.4),
    ],
)
def test_a_models_own_word_and_not_its_name_decides_whether_noise_on_the_speed_is_added(
    name: str, model: type[Still], update: str, expected: float
) -> None:
    own: Registry[MotionModelFactory] = Registry("motion model")
    own.register(name)(lambda: model(name=name))
    assert added_noise(own[name](), {"update": update}) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("model", [Still(), StillThatSpreads()])
def test_a_noise_on_the_speed_that_was_asked_for_holds_for_every_model(model: Still) -> None:
    assert added_noise(model, {"model_error": {"speed": 0.1}}) == pytest.approx(0.1, rel=0.05)


def test_of_the_models_that_come_with_the_filter_only_the_learned_driver_spreads_the_speed_itself() -> None:
    assert [name for name in motion_models if spreads_speed(motion_model(name))] == [
        "empirical",
        "gmm",
        "recurrent",
        "residual",
    ]


def added_noise(motion: MotionModel, options: dict[str, object]) -> float:
    """Return the spread that one prior update adds to the speeds of fast particles, m/s per root second."""
    settings = FilterOptions.model_validate({"particles": 20_000, **options})
    tracker = MixtureTracker(ROAD, SensorModel(), motion, np.random.default_rng(0), settings)
    scan = scan_of(0.0, [(30.0, lane_centre(2))])
    tracker.step(scan)
    before = tracker.mixture
    before.cloud.state[SPEED] = 30.0
    surroundings = around(before.cloud.state)
    nobody = Traffic(np.zeros(0), np.zeros(0))
    situation = Situation(scan, SensorModel(), motion, 0.25, nobody, SensorPlane(scan.ego, ROAD))
    error = tracker.rule.model_error(motion)
    after = prior_update(before, surroundings, situation, bootstrap_proposal, error, np.random.default_rng(1))
    return float(np.std(after.cloud.state[SPEED])) / 0.5
