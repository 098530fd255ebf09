from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mmpf.motion  # noqa: F401
from mmpf.cloud.kinds import LEVELS, MOVING, SHAPE, STANDING, VEHICLE, Sightings
from mmpf.compute.arrays import FloatArray
from mmpf.joint.learned_reach import reach_after
from mmpf.joint_options import JointOptions
from mmpf.motion.protocol import motion_models
from mmpf.scan import SensorModel
from mmpf.tracker import MixtureTracker
from tests.mmpf.scenes import ROAD, belief_of, ego_at, lane_centre, scan_of, spot
from tests.mmpf.test_tracker import tracker_with
from tests.mmpf.test_update_rules import situation_with

PROMISED = SensorModel().detection_probability


def source(kind: int, level: int = -1) -> FloatArray:
    """The posterior of one source that is surely of one kind and level of detectability."""
    kinds = np.zeros((1, *SHAPE))
    kinds[0, kind, 0, level] = 1.0
    return kinds


def counted(
    hit: float, in_view: float = 1.0, run_after: float = 0.0, existence: float = 1.0, kinds: FloatArray | None = None
) -> tuple[float, float]:
    """Detections that were expected and that there were in the ring of one vehicle at 45 m, detected once before."""
    before = belief_of([spot(45.0, lane_centre(2))], existence=[existence]).components
    before = before if kinds is None else replace(before, kinds=kinds)
    sightings = Sightings(
        in_shadow=np.array([in_view * PROMISED]),
        in_plain_view=np.array([PROMISED]),
        claimed=np.zeros(1),
        hit=np.array([hit]),
        run_probability=np.zeros(1),
    )
    situation = situation_with([])
    reach = reach_after(sightings, before, np.array([run_after]), np.array([45.0]), situation, JointOptions())
    assert np.delete(reach.expected, 4) == pytest.approx(0.0)
    return float(reach.expected[4]), float(reach.detected[4])


@pytest.mark.parametrize("hit", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("level", range(LEVELS))
def test_a_vehicle_in_plain_view_counts_with_its_detection_against_the_data_sheets(hit: float, level: int) -> None:
    assert counted(hit, kinds=source(VEHICLE, level)) == pytest.approx((PROMISED, hit))


def test_it_counts_as_far_as_it_is_there() -> None:
    assert counted(1.0, existence=0.3) == pytest.approx((0.3 * PROMISED, 0.3))


@pytest.mark.parametrize("kind", [STANDING, MOVING])
def test_a_false_object_does_not_count(kind: int) -> None:
    assert counted(1.0, kinds=source(kind)) == (0.0, 0.0)


def test_who_is_partly_hidden_does_not_count() -> None:
    assert counted(0.0, in_view=0.8) == (0.0, 0.0)


def test_a_run_of_misses_says_nothing_of_distance() -> None:
    assert counted(0.0, run_after=0.75) == pytest.approx((0.25 * PROMISED, 0.0))


def test_cars_that_drive_away_tell_the_filter_where_its_sensor_sees_worse() -> None:
    tracker = MixtureTracker(ROAD, SensorModel(), motion_models["cvm"](), np.random.default_rng(0))
    rng = np.random.default_rng(1)
    for step in range(200):
        away = [30.0 + 0.25 * step, 40.0 + 0.25 * step]
        seen = [(lon, lane_centre(lane)) for lane, lon in enumerate(away) if lon < 60.0 or rng.random() < 0.5]
        ego = ego_at(lon_m=2.0 * step)
        tracker.step(scan_of(0.1 * step, [(lon + 2.0 * step, lat) for lon, lat in seen], ego))
    shares = tracker.reach.shares(20.0)
    assert shares[3:6].min() > 0.95
    assert shares[6:8].max() < 0.85


@pytest.mark.parametrize("clutter", [0.0, 2.0])
def test_where_three_in_ten_are_detected_about_three_in_ten_is_what_is_learned(clutter: float) -> None:
    tracker = tracker_with(particles=150)
    rng, far = np.random.default_rng(1), slice(6, 9)
    cars = [(62.0, 0), (72.0, 2), (83.0, 4), (-66.0, 1), (-76.0, 3), (-87.0, 0), (20.0, 1), (-20.0, 3)]
    for step in range(300):
        seen = [
            (2.0 * step + away + 0.3 * rng.standard_normal(), lane_centre(lane) + 0.1 * rng.standard_normal())
            for away, lane in cars
            if rng.random() < (0.3 if abs(away) > 60.0 else PROMISED)
        ]
        false = [
            (2.0 * step + rng.uniform(-95.0, 95.0), lane_centre(int(rng.integers(5))))
            for _ in range(rng.poisson(clutter))
        ]
        tracker.step(scan_of(0.1 * step, seen + false, ego_at(lon_m=2.0 * step)))
    reach = tracker.reach
    assert PROMISED * reach.detected[far].sum() / reach.expected[far].sum() == pytest.approx(0.3, abs=0.05)
    assert PROMISED * reach.shares(20.0)[far].mean() == pytest.approx(0.3, abs=0.1)
    assert PROMISED * reach.shares(20.0)[2] == pytest.approx(PROMISED, abs=0.05)
