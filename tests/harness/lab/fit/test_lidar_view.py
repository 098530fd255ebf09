import numpy as np
import pytest

from harness.lab.fit.lidar_view import solid_angles


def test_a_low_car_hides_the_lower_part_of_a_high_truck_alone():
    """The lidar is 1.6 m above the ground; a car of 1.2 m at 20 m stands before a truck of 3.6 m at 50 m."""
    columns = np.array([[20.0, 50.0], [0.0, 0.0], [0.0, 0.0], [0.2, 0.2], [4.0, 2.0], [-1.6, -1.6], [-0.4, 2.0]])
    car, truck = solid_angles(columns[:5], *columns[5:])
    assert car == pytest.approx(2.0 * np.arctan(2.0 / 19.9) * 1.2 / 20.0, rel=1e-3)
    wide = 2.0 * np.arctan(1.0 / 49.9)
    assert truck == pytest.approx(wide * (2.0 / 50.0 + 0.4 / 19.9), rel=1e-3)
    (alone,) = solid_angles(columns[:5, 1:], *columns[5:, 1:])
    assert alone == pytest.approx(wide * 3.6 / 50.0, rel=1e-3)
