"""Rows of structs of arrays are taken and joined column by column, nested structs with them."""

from dataclasses import dataclass

import numpy as np

from mmpf.numerics.arrays import FloatArray, StringArray, joined, taken


@dataclass(frozen=True)
class Places:
    xy_m: FloatArray


@dataclass(frozen=True)
class Cars:
    name: StringArray
    place: Places


CARS = Cars(np.array(["a", "b", "c"]), Places(np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]])))


def test_rows_are_taken_by_number_in_the_order_that_is_asked_for():
    some = taken(CARS, np.array([2, 0]))
    assert some.name.tolist() == ["c", "a"]
    assert some.place.xy_m.tolist() == [[4.0, 5.0], [0.0, 1.0]]


def test_rows_are_taken_by_a_mask():
    assert taken(CARS, np.array([False, True, False])).place.xy_m.tolist() == [[2.0, 3.0]]


def test_a_struct_that_is_taken_apart_and_joined_is_what_it_was():
    whole = joined(taken(CARS, np.array([0])), taken(CARS, np.array([1, 2])))
    assert whole.name.tolist() == CARS.name.tolist()
    assert whole.place.xy_m.tolist() == CARS.place.xy_m.tolist()
