from collections.abc import Sequence

import numpy as np
import pytest

from mmpf.joint.kinds import SHAPE, STANDING, VEHICLE, Sightings
from mmpf.joint.known import Known
from mmpf.joint.range_learning import reach_after
from mmpf.motion.protocol import motion_models
from mmpf.numerics.arrays import FloatArray
from mmpf.options.joint import JointOptions
from mmpf.scan import SensorModel
from mmpf.tracker import MixtureTracker
from tests.mmpf.scenes import ROAD, belief_of, ego_at, lane_centre, scan_of, spot

PROMISED = SensorModel().detection_probability


def surely(kind: int, level: int = -1) -> FloatArray:
    """The posterior of one source whose kind and detectability are known."""
    kinds = np.zeros((1, *SHAPE))
    kinds[:, kind, 0, level] = 1.0
    return kinds


def counted(
    hit: float, in_view: float = 1.0, run_after: float = 0.0, **columns: Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    """Detections that were expected and that there were in the ring of one vehicle at 45 m."""
    vehicle = {"detected_s": [1.0], "existence": [1.0], **columns}
    before = belief_of([spot(45.0, lane_centre(2))], **vehicle).components
    sightings = Sightings(
        in_shadow=np.array([in_view * PROMISED]),
        in_plain_view=np.array([PROMISED]),
        in_field=np.ones(1),
        claimed=np.array([1.0]),
        hit=np.array([hit]),
        run_probability=np.zeros(1),
    )
    known = Known.of_data_sheet(SensorModel())
    reach = reach_after(sightings, before, np.array([run_after]), np.array([45.0]), known, 0.1, JointOptions())
    assert np.delete(reach.expected, 4) == pytest.approx(0.0)
    return reach.expected[4], reach.detected[4]


@pytest.mark.parametrize("hit", [0.0, 0.4, 1.0])
def test_a_vehicle_in_plain_view_counts_with_its_detection_against_the_data_sheets(hit: float) -> None:
    assert counted(hit) == pytest.approx((PROMISED, hit))


@pytest.mark.parametrize("nobody", [{"existence": [0.0]}, {"kinds": surely(STANDING)}, {"detected_s": [0.1]}])
def test_what_does_not_exist_or_is_no_vehicle_or_hardly_known_does_not_count(
    nobody: dict[str, Sequence[float]],
) -> None:
    assert counted(1.0, **nobody) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_a_vehicle_that_is_hard_to_detect_anywhere_says_nothing_of_distance() -> None:
    assert counted(0.0, kinds=surely(VEHICLE, level=0)) == pytest.approx((0.0, 0.0))


def test_who_is_partly_hidden_does_not_count() -> None:
    assert counted(0.0, in_view=0.8) == (0.0, 0.0)


def test_a_run_of_misses_says_nothing_of_distance() -> None:
    assert counted(0.0, run_after=0.75) == pytest.approx((0.25 * PROMISED, 0.0))


@pytest.mark.slow
def test_cars_that_drive_away_tell_the_filter_where_its_sensor_sees_worse() -> None:
    tracker = MixtureTracker(ROAD, SensorModel(), motion_models["cvm"](), np.random.default_rng(0))
    rng = np.random.default_rng(1)
    for step in range(200):
        away = [30.0 + 0.25 * step, 40.0 + 0.25 * step]
        seen = [(lon, lane_centre(lane)) for lane, lon in enumerate(away) if lon < 60.0 or rng.random() < 0.5]
        ego = ego_at(lon_m=2.0 * step)
        tracker.step(scan_of(0.1 * step, [(lon + 2.0 * step, lat) for lon, lat in seen], ego))
    shares = tracker.reach.shares()
    assert shares[3:6].min() > 0.95
    assert shares[6:8].max() < 0.85
