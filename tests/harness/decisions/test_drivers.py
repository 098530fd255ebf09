"""What the drivers would do, against closed forms and published properties."""

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.decisions.belief import believe
from harness.decisions.decide import decide, driver_of, most_decisive
from harness.decisions.drivers.following import PARAMETERS
from harness.decisions.drivers.protocol import Command, drivers
from mmpf.map.corridor_road import highway
from mmpf.motion.idm import idm_acceleration
from mmpf.motion.protocol import Neighbour
from tests.harness.decisions.scenes import LENGTH_M, bodies, egos

ROAD = highway(lanes=3, lane_width_m=3.66)
MIDDLE, LEFT = 1.5 * 3.66, 2.5 * 3.66


def asked(name, *rows, **ego):
    return decide(driver_of(name), bodies(*rows), egos(lat=MIDDLE, lane=2, **ego), ROAD).command


def test_the_intelligent_driver_is_that_of_the_motion_model():
    rng = np.random.default_rng(0)
    gap, speed, leaders_speed = rng.uniform(5, 100, 50), rng.uniform(0, 30, 50), rng.uniform(0, 30, 50)
    rows = [(step, gap[step] + LENGTH_M, MIDDLE, leaders_speed[step]) for step in range(50)]
    ahead = Neighbour(np.ones(50, dtype=bool), gap, leaders_speed, np.zeros(50), np.full(50, LENGTH_M))
    expected = idm_acceleration(speed, ahead, PARAMETERS)
    assert asked("idm", *rows, steps=50, speed=speed).accel_mps2 == pytest.approx(expected)


def test_on_a_free_road_all_drivers_want_the_same():
    free = PARAMETERS.max_accel_mps2 * (1.0 - (20.0 / PARAMETERS.desired_speed_mps) ** 4)
    for name in drivers:
        assert asked(name).accel_mps2[0] == pytest.approx(free)


def test_a_platoon_in_equilibrium_drives_at_the_gaps_of_the_intelligent_driver():
    # Endless in the paper; with three leaders at multiples of one gap the renormalised sum is exactly the same.
    speed, gap = 20.0, 25.0
    spacing = gap + LENGTH_M
    rows = [(0, spacing * (j + 1), MIDDLE, speed) for j in range(3)]
    assert asked("hdm", *rows).accel_mps2 == pytest.approx(asked("idm", *rows).accel_mps2)


def test_only_who_looks_beyond_the_leader_brakes_for_the_one_before_it():
    steady = [(0, 30.0, MIDDLE, 20.0)]
    braking = [*steady, (0, 55.0, MIDDLE, 8.0)]
    assert asked("idm", *braking).accel_mps2 == asked("idm", *steady).accel_mps2
    assert asked("hdm", *braking).accel_mps2[0] < asked("hdm", *steady).accel_mps2[0] - 2.0


def test_no_driver_brakes_harder_than_a_car_can():
    for name in drivers:
        assert asked(name, (0, 5.0, MIDDLE, 0.0)).accel_mps2[0] == -9.0


def test_a_gap_is_safe_if_nobody_has_to_brake_hard():
    def accepts(*rows):
        return asked("idm", *rows).accepts_left[0]

    assert accepts()
    assert accepts((0, 40.0, LEFT, 20.0), (0, -40.0, LEFT, 20.0))
    assert not accepts((0, -12.0, LEFT, 30.0))
    assert not accepts((0, 12.0, LEFT, 10.0))
    assert not accepts((0, 3.0, LEFT, 20.0))


def test_mobil_takes_a_safe_gap_only_where_it_gains():
    slow_ahead = (0, 25.0, MIDDLE, 12.0)
    assert asked("mobil", slow_ahead).accepts_left[0]
    assert not asked("mobil").accepts_left[0]
    assert asked("hdm").accepts_left[0]
    assert not asked("mobil", slow_ahead, (0, 24.0, LEFT, 12.0)).accepts_left[0]


def test_mobil_gives_way_to_who_would_lose_more_than_it_gains():
    slightly_slower, close_behind = (0, 45.0, MIDDLE, 19.0), (0, -22.0, LEFT, 21.0)
    assert asked("mobil", slightly_slower).accepts_left[0]
    assert asked("idm", slightly_slower, close_behind).accepts_left[0]
    assert not asked("mobil", slightly_slower, close_behind).accepts_left[0]
    hardly_slower, held_up = (0, 100.0, MIDDLE, 20.0), (0, -12.0, MIDDLE, 21.0)
    assert not asked("mobil", hardly_slower).accepts_left[0]
    assert asked("mobil", hardly_slower, held_up).accepts_left[0], "who is behind gains enough"


def test_the_most_decisive_vehicle_is_the_one_that_slows_the_driver_most():
    steady_then_braking = bodies((0, 30.0, MIDDLE, 20.0), (0, 55.0, MIDDLE, 8.0))
    belief = believe(steady_then_braking, egos(lat=MIDDLE, lane=2), ROAD)
    assert most_decisive(driver_of("hdm"), belief).tolist() == [1]
    assert most_decisive(driver_of("idm"), belief).tolist() == [0]
    assert most_decisive(driver_of("hdm"), believe(bodies(), egos(), ROAD)).tolist() == [-1]


class Silent:
    """A driver that knows no answer."""

    def command(self, belief):
        return Command(np.full(len(belief), np.nan), belief.left.exists, belief.right.exists)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("idn", "`driver` idn: unknown; choose one of hdm, idm, mobil, or module:factory for your own"),
        ("sumo", "`driver` sumo: SUMO's own model answers within a running simulation alone; choose one of hdm"),
        ("no_such_module:Driver", "`driver` no_such_module:Driver: can't import the driver"),
        (f"{__name__}:bodies", "it returned Bodies, which has no method command"),
        (f"{__name__}:asked", "it can't be built"),
    ],
)
def test_a_driver_that_there_is_not_is_answered_in_one_line(name, message):
    with pytest.raises(InputError) as error:
        driver_of(name)
    assert message in str(error.value)


def test_a_driver_without_an_answer_is_an_error():
    with pytest.raises(ValueError, match="Silent returned no finite acceleration"):
        asked(f"{__name__}:Silent")
