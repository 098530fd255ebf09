"""Two components for one vehicle become one, under the name that was reported first."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.joint.kinds import STANDING, certain_vehicles
from mmpf.joint.merging import merge_lasting_overlaps
from mmpf.joint.rule import JointUpdate
from mmpf.motion.state import LON, SPEED
from mmpf.options.filter import FilterOptions
from mmpf.options.joint import JointIdentity, JointMerging, JointOptions
from mmpf.scan import SensorModel
from tests.mmpf.scenes import belief_of, lane_centre, spot
from tests.mmpf.test_update_rules import situation_with

PARTICLES = 200
ELDER, YOUNGER = 3, 8
OPTIONS = JointMerging(lon_m=2.5, lat_m=1.4, after_s=0.25)


def elder_and_younger(
    apart_m: float, confirmed: tuple[bool, bool], unseen_s: tuple[float, float], std_m: float = 0.3
) -> Mixture:
    """Return a belief of two components in one lane; the younger one has had enough detections to be confirmed."""
    states = [spot(lon_m, lane_centre(2), 0.0, PARTICLES) for lon_m in (30.0, 30.0 + apart_m)]
    columns = {"track_id": [ELDER, YOUNGER], "hits": [40, 5], "detected_s": [3.9, 0.4]}
    mixture = belief_of(states, **columns, confirmed=confirmed, unseen_s=unseen_s)
    mixture.cloud.state[LON] += std_m * np.random.default_rng(0).standard_normal(2 * PARTICLES)
    return mixture


def merged_after(mixture: Mixture, scans: int, dt_s: float = 0.1) -> Mixture:
    for _ in range(scans):
        alive = np.ones(len(mixture), dtype=bool)
        mixture, keep = merge_lasting_overlaps(mixture, component_moments(mixture), alive, OPTIONS, 0.25, dt_s)
        mixture = mixture.keep(keep)
    return mixture


@pytest.mark.parametrize("hits", list(permutations((40, 20, 5))))
@pytest.mark.parametrize("reported", [[ELDER], [ELDER, 9]])
def test_of_three_in_one_place_the_names_that_were_reported_stay(
    hits: tuple[int, int, int], reported: list[int]
) -> None:
    """The elder is hidden, so that it is not the third if that was reported too."""
    two, other = (elder_and_younger(apart_m, (True, False), (0.5, 0.0)) for apart_m in (0.4, 0.8))
    third = other.keep(np.array([False, True]))
    three = two.keep_and_join(np.ones(2, bool), third.cloud, replace(third.components, track_id=np.array([9])))
    confirmed = np.isin(three.components.track_id, reported)
    components = replace(three.components, hits=np.array(hits), confirmed=confirmed)
    merged = merged_after(replace(three, components=components), 4)
    assert sorted(merged.components.track_id) == reported
    assert merged.components.confirmed.all()


@pytest.mark.parametrize("unseen_s", [(0.0, 0.0), (1.5, 0.0), (0.0, 1.5)], ids=["both seen", "elder", "younger"])
@pytest.mark.parametrize(
    ("reported", "name"), [((True, False), ELDER), ((False, True), YOUNGER), ((False, False), ELDER)]
)
def test_the_reported_name_stays_or_else_the_elders_in_the_place_of_the_one_seen_last(
    reported: tuple[bool, bool], name: int, unseen_s: tuple[float, float]
) -> None:
    merged = merged_after(elder_and_younger(1.0, reported, unseen_s), 3)
    assert merged.components.track_id.tolist() == [name]
    assert merged.components.confirmed.tolist() == [any(reported)]
    better = 30.0 if unseen_s[0] <= unseen_s[1] else 31.0
    assert merged.cloud.state[LON].mean() == pytest.approx(better, abs=0.2)


@pytest.mark.parametrize("unseen_s", [(0.1, 0.0), (1.5, 1.5)], ids=["both seen", "both hidden"])
def test_two_that_were_both_reported_are_merged_if_both_are_seen_or_both_hidden(unseen_s: tuple[float, float]) -> None:
    assert merged_after(elder_and_younger(1.0, (True, True), unseen_s), 3).components.track_id.tolist() == [ELDER]


def test_scans_in_one_place_count_in_a_row_only() -> None:
    near, far = elder_and_younger(1.0, (True, False), (0.0, 0.0)), elder_and_younger(6.0, (True, False), (0.0, 0.0))
    after = merged_after(near, 2)
    apart = merged_after(replace(far, components=after.components), 1)
    assert len(merged_after(replace(near, components=apart.components), 2)) == 2
    assert len(merged_after(replace(near, components=apart.components), 3)) == 1


def test_one_that_is_about_to_be_removed_merges_with_nobody() -> None:
    mixture = elder_and_younger(1.0, (True, False), (0.0, 0.0))
    for _ in range(5):
        alive = np.array([True, False])
        mixture, keep = merge_lasting_overlaps(mixture, component_moments(mixture), alive, OPTIONS, 0.25, 0.1)
        assert keep.tolist() == [True, False]


@pytest.mark.parametrize(("dt_s", "scans"), [(0.05, 6), (0.1, 3), (0.2, 2), (0.5, 1)])
def test_how_many_scans_in_one_place_are_enough_is_a_matter_of_time(dt_s: float, scans: int) -> None:
    pair = elder_and_younger(1.0, (True, False), (0.0, 0.0))
    assert len(merged_after(pair, scans - 1, dt_s)) == 2
    assert len(merged_after(pair, scans, dt_s)) == 1


@pytest.mark.parametrize(("reported", "probable"), [(True, 1.0 - (1.0 - 0.9 * 0.8) * (1.0 - 0.9 * 0.3)), (False, 0.27)])
def test_a_reported_vehicle_stays_as_probable_as_it_was_when_a_doubtful_one_detects_it(
    reported: bool, probable: float
) -> None:
    """Of two independent reasons to believe in a vehicle either is enough."""
    mixture = elder_and_younger(1.0, (reported, False), (1.5, 0.0))
    kinds = certain_vehicles(2) * np.array([0.8, 0.3])[:, None, None, None]
    kinds[:, STANDING, 0, 0] = 0.2, 0.7
    merged = merged_after(replace(mixture, components=replace(mixture.components, kinds=kinds)), 3)
    assert merged.components.vehicle == pytest.approx(probable)


@pytest.mark.parametrize(
    ("apart_m", "confirmed", "unseen_s", "share"),
    [
        (1.0, (True, True), (1.5, 0.0), 1.0),
        (1.0, (True, True), (0.0, 0.0), 1.0),
        (3.0, (True, False), (0.0, 0.0), 1.0),
        (1.0, (True, False), (1.5, 0.0), 0.1),
    ],
    ids=["one hidden", "a detection each", "three metres apart", "a false object beside a hidden vehicle"],
)
def test_two_stay_two(
    apart_m: float, confirmed: tuple[bool, bool], unseen_s: tuple[float, float], share: float
) -> None:
    mixture = elder_and_younger(apart_m, confirmed, unseen_s)
    kinds = certain_vehicles(2) * np.array([1.0, share])[:, None, None, None]
    kinds[1, STANDING, 0, 0] = 1.0 - share
    assert len(merged_after(replace(mixture, components=replace(mixture.components, kinds=kinds)), 10)) == 2


def confirmed_after_finetuning(mixture: Mixture) -> list[bool]:
    options = FilterOptions(particles=PARTICLES, joint=JointOptions(identity=JointIdentity(stitch=False)))
    rule, moments = JointUpdate(options, SensorModel()), component_moments(mixture)
    finetuned = rule.finetune(mixture, moments, situation_with([]), np.random.default_rng(0))
    return finetuned.mixture.components.confirmed.tolist()


@pytest.mark.parametrize("unseen_s", [0.0, 1.5])
def test_nothing_is_confirmed_on_top_of_a_confirmed_vehicle_whose_place_is_known(unseen_s: float) -> None:
    assert confirmed_after_finetuning(elder_and_younger(2.0, (True, False), (unseen_s, 0.0))) == [True, False]
    assert confirmed_after_finetuning(elder_and_younger(6.0, (True, False), (unseen_s, 0.0))) == [True, True]


def test_a_confirmed_vehicle_that_may_be_anywhere_keeps_nobody_from_being_confirmed() -> None:
    assert confirmed_after_finetuning(elder_and_younger(2.0, (True, False), (1.5, 0.0), std_m=4.0)) == [True, True]


def test_a_truck_takes_the_room_of_a_truck() -> None:
    mixture = elder_and_younger(6.0, (True, False), (0.0, 0.0))
    truck = replace(mixture, components=replace(mixture.components, length_m=np.array([18.0, 4.7])))
    assert confirmed_after_finetuning(truck) == [True, False]


def test_a_stray_that_hardly_exists_takes_no_tracks_name() -> None:
    mixture = elder_and_younger(1.0, (False, True), (0.0, 0.0))
    stray = replace(mixture, components=replace(mixture.components, existence=np.array([0.1, 0.9])))
    assert merged_after(stray, 10).components.track_id.tolist() == [ELDER, YOUNGER]


@pytest.mark.parametrize(("faster_mps", "left"), [(3.5, 1), (4.5, 2)])
def test_two_that_pass_each_other_stay_two(faster_mps: float, left: int) -> None:
    mixture = elder_and_younger(1.0, (True, False), (0.0, 0.0))
    mixture.cloud.state[SPEED, PARTICLES:] += faster_mps
    assert len(merged_after(mixture, 5)) == left
