"""The field of view: who is outside of it can't be seen."""

import numpy as np
import pytest

from mmpf import highway
from mmpf.map.sensor_plane import SensorPlane
from mmpf.scan import EgoPose, FreeSpace, SensorModel
from mmpf.visibility.field import share_in_field, worth_at_edge

PLANE = SensorPlane(EgoPose(100.0, 0.0, 0.0, 20.0, 4.7, 1.9), highway())
BEARINGS = -np.pi + 2.0 * np.pi * (np.arange(720) + 0.5) / 720
AHEAD = FreeSpace(np.where(np.abs(BEARINGS) < np.pi / 4, 80.0, 0.0))
SHEET = SensorModel()


def share(x: float, y: float, free_space: FreeSpace | None = AHEAD) -> float:
    """Return the share in view of a vehicle at a place, seen from the sensor."""
    shares = share_in_field(PLANE, np.array([100.0 + x]), np.array([y]), np.array([1.5]), free_space)
    return float(shares[0])


def test_ahead_all_is_in_view_and_behind_nothing() -> None:
    assert share(30.0, 0.0) == pytest.approx(1.0)
    assert share(-30.0, 0.01) == pytest.approx(0.0)
    assert share(-30.0, -0.01) == pytest.approx(0.0)


def test_on_the_edge_half_is_in_view() -> None:
    assert share(20.0, 20.0) == pytest.approx(0.5, abs=0.01)


def test_a_sensor_that_sees_all_around_has_no_edge() -> None:
    all_around = FreeSpace(np.full(720, 80.0))
    place = np.array([100.0]), np.array([0.0]), np.array([1.5])
    assert share_in_field(PLANE, *place, all_around) is None
    assert share_in_field(PLANE, *place, None) is None


def test_outside_only_the_hidden_probability_remains() -> None:
    worth = worth_at_edge(np.array([1.0, 0.35, 0.0]), SHEET, 0.02)
    assert worth == pytest.approx([1.0, 0.35 / SHEET.full_view_fraction, 0.02])
