"""A component confirmed where a hidden one may be takes its name, and each name is borne once."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.joint.identity import KERNEL_WIDTHS, hand_over_identity
from mmpf.joint.kinds import LEVELS, STANDING, certain_vehicles
from mmpf.motion.state import LON
from mmpf.options.joint import JointIdentity
from tests.mmpf.scenes import belief_of, spot

SCAN_S = 0.1
OPTIONS = JointIdentity()
HIDDEN, NEW = 7, 30


def hidden_and_new(
    apart_m: float = 1.0, unseen_s: float = 2.0, age_s: float = 0.3, apart_mps: float = 0.0, existence: float = 0.9
) -> Mixture:
    return belief_of(
        [spot(50.0, 5.0), spot(50.0 + apart_m, 5.0, 20.0 + apart_mps)],
        track_id=[HIDDEN, NEW],
        confirmed=[True, True],
        unseen_s=[unseen_s, 0.0],
        age_s=[6.0, age_s],
        existence=[existence, 0.95],
    )


def handed_over(mixture: Mixture, confirmed_now: list[bool], scan_s: float = SCAN_S) -> tuple[Mixture, int]:
    now = np.array(confirmed_now, dtype=np.bool_)
    after = hand_over_identity(mixture, component_moments(mixture), now, OPTIONS, scan_s)
    assert (after.moments.mean == component_moments(after.mixture).mean).all()
    return after.mixture, after.settled


def names_after(mixture: Mixture, scan_s: float = SCAN_S) -> list[int]:
    after, _ = handed_over(mixture, [False, True], scan_s)
    return after.components.track_id.tolist()


def test_one_confirmed_beside_a_hidden_one_takes_its_name_and_the_hidden_one_is_gone() -> None:
    mixture = hidden_and_new()
    after, count = handed_over(mixture, [False, True])
    assert (after.components.track_id.tolist(), count) == ([HIDDEN], 1)
    assert after.cloud.state[LON] == pytest.approx(51.0), "the particles are those of the one that is seen"
    assert after.next_track_id == mixture.next_track_id


def test_who_is_too_far_away_or_too_fast_is_somebody_else() -> None:
    assert names_after(hidden_and_new(apart_m=12.0)) == [HIDDEN, NEW]
    assert names_after(hidden_and_new(apart_mps=12.0)) == [HIDDEN, NEW]


@pytest.mark.parametrize(("turned_rad", "linked"), [(0.0, 1), (0.5, 1), (np.pi, 0)])
def test_a_vehicle_that_heads_another_way_is_not_the_hidden_one_seen_again(turned_rad: float, linked: int) -> None:
    mixture = hidden_and_new(apart_m=0.0)
    moments = replace(component_moments(mixture), heading_rad=np.array([0.0, turned_rad]))
    assert hand_over_identity(mixture, moments, np.array([False, True]), OPTIONS, SCAN_S).settled == linked


@pytest.mark.parametrize("existence", [0.2, 0.9])
@pytest.mark.parametrize("axis", ["place", "speed"])
def test_the_hidden_one_must_explain_it_better_than_a_vehicle_never_seen(axis: str, existence: float) -> None:
    peak = existence / ((2.0 * np.pi) ** 1.5 * np.prod(KERNEL_WIDTHS))
    reach = np.sqrt(2.0 * np.log(peak / OPTIONS.unknown_density)) * KERNEL_WIDTHS[0 if axis == "place" else 2]
    for share, names in ((0.99, [HIDDEN]), (1.01, [HIDDEN, NEW])):
        apart = {"apart_m": share * reach} if axis == "place" else {"apart_m": 0.0, "apart_mps": share * reach}
        assert names_after(hidden_and_new(existence=existence, **apart)) == names


@pytest.mark.parametrize(("misses", "names"), [(0, [HIDDEN, NEW]), (1, [HIDDEN, NEW]), (2, [HIDDEN])])
def test_one_that_was_missed_in_a_single_scan_is_not_hidden_yet(misses: int, names: list[int]) -> None:
    """Rounding of the scans' times decides nothing."""
    for time_s in np.arange(100) * SCAN_S:
        one_s, other_s = np.diff(time_s + SCAN_S * np.arange(3))
        mixture = hidden_and_new(unseen_s=[0.0, other_s, one_s + other_s][misses])
        assert names_after(mixture, other_s) == names


@pytest.mark.parametrize(("age_s", "names"), [(2.4, [HIDDEN]), (sum([SCAN_S] * 25), [HIDDEN]), (2.6, [HIDDEN, NEW])])
def test_two_that_were_both_seen_for_long_are_two_vehicles(age_s: float, names: list[int]) -> None:
    assert names_after(hidden_and_new(unseen_s=2.0, age_s=age_s)) == names


def test_a_hidden_one_that_was_never_confirmed_has_no_name_to_give() -> None:
    mixture = hidden_and_new()
    components = replace(mixture.components, confirmed=np.array([False, True]))
    assert names_after(replace(mixture, components=components)) == [HIDDEN, NEW]


def test_of_two_that_appear_beside_one_hidden_vehicle_the_nearer_takes_its_name() -> None:
    mixture = belief_of(
        [spot(53.0, 5.0), spot(50.0, 5.0), spot(51.0, 5.0)],
        track_id=[30, HIDDEN, 31],
        confirmed=[True] * 3,
        unseen_s=[0.0, 2.0, 0.0],
    )
    after, count = handed_over(mixture, [True, False, True])
    assert (after.components.track_id.tolist(), count) == ([30, HIDDEN], 1)


def test_pairs_are_settled_together_and_not_one_after_the_other() -> None:
    """The first new one is nearest to the second hidden one, which is all that the second new one can be."""
    mixture = belief_of(
        [spot(46.0, 5.0), spot(50.0, 5.0), spot(49.0, 5.0), spot(55.0, 5.0)],
        track_id=[1, 2, 30, 31],
        confirmed=[True] * 4,
        unseen_s=[2.0, 2.0, 0.0, 0.0],
    )
    after, count = handed_over(mixture, [False, False, True, True])
    assert (after.components.track_id.tolist(), count) == ([1, 2], 2)


def test_the_size_that_was_known_of_the_hidden_one_is_kept() -> None:
    mixture = hidden_and_new()
    components = replace(mixture.components, length_m=np.array([16.0, 4.7]), std_length_m=np.array([0.5, 2.0]))
    after, _ = handed_over(replace(mixture, components=components), [False, True])
    precision = np.array([0.5, 2.0]) ** -2
    assert after.components.length_m == pytest.approx([np.average([16.0, 4.7], weights=precision)])


@pytest.mark.parametrize("apart_m", [0.5, 6.7])
def test_one_seen_again_is_a_vehicle_unless_neither_it_nor_the_hidden_one_that_it_may_be_is(apart_m: float) -> None:
    mixture = hidden_and_new(apart_m, existence=0.9)
    kinds = certain_vehicles(2) * np.array([0.8, 0.3])[:, None, None, None]
    kinds[:, STANDING, 0, 0] = 0.2, 0.7
    ended, in_view = np.full((2, 2, LEVELS), 0.05 / (2 * LEVELS)), np.array([0.2, 0.7])
    components = replace(mixture.components, kinds=kinds, ended=ended, born_in_view=in_view)
    after, _ = handed_over(replace(mixture, components=components), [False, True])
    widths = np.array(KERNEL_WIDTHS)
    density = 0.9 * norm.pdf([apart_m, 0.0, 0.0], scale=widths).prod()
    same = density / (density + OPTIONS.unknown_density)
    known, own = same * 0.9 * 0.8, 0.95 * 0.3
    assert after.components.vehicle == pytest.approx([1.0 - (1.0 - own) * (1.0 - known)])
    born_in_view = known * 0.2 + (1.0 - known) * own * 0.7
    assert after.components.vehicle * after.components.born_in_view == pytest.approx([born_in_view])
    assert after.components.ended.sum() == pytest.approx((1.0 - known) * 0.05)
    assert after.components.existence + after.components.ended.sum() == pytest.approx([1.0])
    assert after.components.mistaken == pytest.approx([1.0 - same * own])
    assert after.components.away_std == pytest.approx(np.array([[apart_m, 0.0, 0.0]]))


@given(st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_no_name_is_ever_borne_twice_and_none_is_made_up(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(0, 9))
    is_new = rng.uniform(size=count) < 0.5
    mixture = belief_of(
        [spot(rng.uniform(0.0, 15.0), rng.uniform(0.0, 4.0), rng.uniform(18.0, 22.0)) for _ in range(count)],
        track_id=rng.permutation(50)[:count],
        confirmed=is_new | (rng.uniform(size=count) < 0.7),
        unseen_s=np.where(is_new, 0.0, rng.uniform(0.0, 3.0, count)),
        age_s=rng.uniform(0.0, 4.0, count),
    )
    after, handed = handed_over(mixture, is_new.tolist())
    names = after.components.track_id.tolist()
    assert len(set(names)) == len(names) == count - handed
    assert set(names) <= set(mixture.components.track_id.tolist())


def withdrawn_and_new(apart_m: float = 1.0) -> Mixture:
    return belief_of(
        [spot(50.0, 5.0), spot(50.0 + apart_m, 5.0)],
        track_id=[HIDDEN, NEW],
        confirmed=[False, True],
        withdrawn=[True, False],
        unseen_s=[0.0, 0.0],
        age_s=[6.0, 0.3],
        existence=[0.9, 0.95],
    )


@pytest.mark.parametrize(("apart_m", "names"), [(1.0, [NEW, HIDDEN]), (12.0, [HIDDEN, NEW])])
def test_one_confirmed_where_a_track_was_just_withdrawn_takes_its_name_and_both_stay(apart_m: float, names: list[int]):
    after, count = handed_over(withdrawn_and_new(apart_m), [False, True])
    assert (after.components.track_id.tolist(), count) == (names, int(apart_m < 12.0))
    assert after.components.withdrawn.tolist() == [apart_m == 12.0, False], "a name is handed over once"
    assert after.components.confirmed.tolist() == [False, True]
