"""Declared numbers are checked as a plain loop over the rows checks them; messages name column, row and value."""

import math
from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.common.bounds import Numbers, check_columns, check_moves, check_numbers
from harness.common.errors import InputError

VALUES = st.lists(st.sampled_from([-1.0, 0.0, 0.5, 1.0, 2.0, math.nan, math.inf]), max_size=4)


@given(VALUES, st.booleans(), st.booleans(), st.booleans())
def test_what_is_allowed_is_what_a_loop_over_the_rows_allows(values, whole, rising, gaps):
    def is_wrong(k: int) -> bool:
        value = values[k]
        if math.isnan(value):
            return not gaps or rising
        falls = rising and k > 0 and not value > values[k - 1]
        return not 0.0 <= value <= 1.0 or (whole and value % 1.0 != 0.0) or falls

    wrong = any(map(is_wrong, range(len(values))))
    with pytest.raises(ValueError, match="speed") if wrong else nullcontext():
        Numbers(0.0, 1.0, whole, rising, gaps).check("speed", values)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ([1, 2, 9], "a.csv: speed of row 3 is 9, not from 0 to 3"),
        ([[1.0, 2.0], [3.0, np.nan]], "speed of row 2 is missing or not finite"),
        (["1", "far"], "speed holds 'far', not numbers"),
        ([True, False], "speed holds True, not numbers"),
    ],
)
def test_a_message_names_the_column_the_row_and_the_value(values, told):
    with pytest.raises(InputError) as error:
        check_numbers("a.csv", {"speed": values, "other": ["any"]}, {"speed": Numbers(0.0, 3.0), "absent": Numbers()})
    assert told.removeprefix("a.csv: ") in str(error.value)
    assert str(error.value).startswith("a.csv: ")


def test_columns_that_are_missing_are_named_together():
    with pytest.raises(InputError, match="it has no column b, c, but a, d"):
        check_columns("a.csv", ["a", "d"], ["a", "b", "c"])


def test_an_ego_that_moves_as_no_car_does_is_refused():
    ways = {"moves backwards": (-2.0, 0.0, 0.0), "leaps": (20.0, 0.0, 0.0), "moves sideways": (1.0, 2.0, 0.0)}
    for told, (x_m, y_m, turned_rad) in (ways | {"turns at once": (1.0, 0.0, 1.5)}).items():
        rows = ([0.0, 0.1], [0.0, x_m], [0.0, y_m], [0.0, turned_rad])
        with pytest.raises(InputError, match=f"car {told} at 0.1 s"):
            check_moves("poses", np.full(2, "car"), *map(np.array, rows), is_ego=True)
