"""Lists of values as they are typed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.common.errors import InputError
from harness.config.lists import names, numbers, seed_values


def test_a_range_stops_below_an_end_that_no_step_reaches_and_has_no_binary_crumbs():
    assert numbers("0:1:0.4", "vary", "") == (0.0, 0.4, 0.8)
    assert numbers("0:0.3:0.1", "vary", "") == (0.0, 0.1, 0.2, 0.3)


@given(st.integers(0, 1000), st.integers(0, 200), st.integers(1, 50))
def test_a_range_of_whole_numbers_is_pythons_range(start, length, step):
    expected = tuple(range(start, start + length + 1, step))
    assert numbers(f"{start}:{start + length}:{step}", "densities", "") == expected


@pytest.mark.parametrize(
    "text", ["65:5:10", "abc", "", "5:65", "5:65:0", "5:65:-1", "5,,6", "5,5", "nan", "inf", "1:1e9:1"]
)
def test_a_wrong_list_of_numbers_is_answered_with_a_right_one(text):
    with pytest.raises(InputError, match=r"^`densities` .*for example `densities` 5:65:10$"):
        numbers(text, "densities", "5:65:10")


def test_names_are_separated_by_commas_but_for_those_within_square_brackets():
    assert names("gmm, cvm", "models", "gmm,cvm") == ("gmm", "cvm")
    words = ("mmpf", "mmpf+levels=[0,1]+x=[2,3]", "pmbm")
    assert names(",".join(words), "trackers", "mmpf") == words


@pytest.mark.parametrize("text", ["", "gmm,", "gmm,gmm"])
def test_a_wrong_list_of_names_is_answered_with_a_right_one(text):
    with pytest.raises(InputError, match=r"for example `models` gmm,cvm$"):
        names(text, "models", "gmm,cvm")


def test_a_number_of_seeds_counts_from_zero_and_a_range_leaves_out_its_end():
    assert list(seed_values("3")) == [0, 1, 2]
    assert list(seed_values("100:102")) == [100, 101]


@pytest.mark.parametrize("text", ["0", "-1", "5:5", "6:5", "a:b", "", "1:2:3", "1:99999999999"])
def test_wrong_seeds_are_answered_with_right_ones(text):
    with pytest.raises(InputError, match=r"for example `seeds` 10$"):
        seed_values(text)
