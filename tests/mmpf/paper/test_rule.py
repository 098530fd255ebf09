"""The paper's rule: what it reads from the road, and where its charitable reading departs from the literal one."""

from dataclasses import replace

import numpy as np
import pytest

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion import motion_model
from mmpf.motion.state import LON
from mmpf.options.filter import FilterOptions
from mmpf.options.paper import MaxLikelihoodOptions, PaperReclustering
from mmpf.paper.clustering import recluster
from mmpf.paper.rule import MaxLikelihoodUpdate
from mmpf.scan import FreeSpace, SensorModel
from mmpf.stages.update_rule import Updated
from mmpf.tracker import MixtureTracker
from tests.mmpf.scenes import ROAD, belief_of, ego_at, lane_centre, scan_of, spot
from tests.mmpf.test_update_rules import mixture_at, situation_with, weights_after

LANE = lane_centre(2)
CHARITABLE = {"reading": "charitable"}


def rule_with(settings: dict[str, object]) -> MaxLikelihoodUpdate:
    options = FilterOptions.model_validate({"update": "max_likelihood", "particles": 400, "max_likelihood": settings})
    return MaxLikelihoodUpdate(options, SensorModel())


def after_merging(rule: MaxLikelihoodUpdate, belief: Mixture) -> Mixture:
    updated = Updated(belief, np.zeros(0), 0.0, 1.0)
    return rule.remove_add_merge(updated, situation_with([]), np.random.default_rng(0)).mixture


@pytest.mark.parametrize("turn_deg", [0, 90, -135])
def test_a_covered_car_performs_no_update_wherever_the_road_leads(turn_deg: int) -> None:
    turn = np.deg2rad(turn_deg)
    road = replace(ROAD, reference_xy=((0.0, 0.0), (float(np.cos(turn)), float(np.sin(turn)))))
    ahead = np.full(720, 100.0)
    ahead[350:370] = 30.0
    prior, situation = mixture_at([(20.0, LANE), (60.0, LANE), (-60.0, LANE)]), situation_with([])
    free_space = FreeSpace(np.roll(ahead, 2 * turn_deg))
    scan = replace(situation.scan, free_space=free_space)
    situation = replace(situation, scan=scan, plane=SensorPlane(scan.ego, road))
    occlusion = rule_with({}).assert_occlusion(prior, component_moments(prior), situation)
    assert occlusion.detection_probability[prior.starts[:-1]].tolist() == [1.0, 0.0, 1.0]


def test_the_charitable_reading_gives_other_defaults_and_leaves_what_is_set_by_hand() -> None:
    literal = MaxLikelihoodOptions()
    read = MaxLikelihoodOptions.model_validate({**CHARITABLE, "association": {"gate_std": 5.0, "hit_gate_std": 4.0}})
    assert (literal.association.gate_std, literal.existence.weights_anew) == (float("inf"), False)
    assert (read.association.gate_std, read.association.hit_gate_std) == (5.0, 4.0)
    assert (read.existence.weights_anew, read.merging.keep_seen, read.reclustering.alike) == (True, True, True)
    assert (read.reclustering.lon_m, read.reclustering.lat_m, read.removal.unconfirmed_unseen_s) == (3.0, 1.2, 1.0)
    assert MaxLikelihoodOptions.model_validate(read.model_dump()) == read


@pytest.mark.parametrize(("reading", "remembers"), [("literal", True), ("charitable", False)])
def test_component_weights_begin_alike_in_every_scan_of_the_charitable_reading(reading: str, remembers: bool) -> None:
    prior = mixture_at([(30.0, LANE), (60.0, lane_centre(1))], std_m=0.5)
    share = np.array([0.999, 0.001])
    uneven = replace(prior, cloud=replace(prior.cloud, log_component_weight=np.log(share)[prior.cloud.component]))
    detections = [(30.0, LANE), (60.0, lane_centre(1))]
    rule = rule_with({"reading": reading, "resampling": {"effective_share": 0.0}})

    def ratio(belief: Mixture) -> float:
        first, second = weights_after(rule, belief, detections).cloud.log_component_weight[prior.starts[:-1]]
        return float(np.exp(first - second))

    assert ratio(uneven) / ratio(prior) == pytest.approx(999.0 if remembers else 1.0)


@pytest.mark.parametrize(("reading", "name"), [("literal", 1), ("charitable", 2)])
def test_two_that_overlap_become_one_under_the_name_of_the_seen_one(reading: str, name: int) -> None:
    belief = belief_of([spot(30.0, LANE), spot(31.0, LANE)], unseen_s=[2.0, 0.0], confirmed=[True, True])
    merged = after_merging(rule_with({"reading": reading}), belief)
    assert merged.components.track_id.tolist() == [name]
    assert len(merged.cloud) == len(belief.cloud)


def test_a_newborn_gives_its_sight_to_the_confirmed_one_that_it_is_merged_into() -> None:
    belief = belief_of([spot(30.0, LANE), spot(31.0, LANE)], unseen_s=[0.0, 2.0], confirmed=[False, True])
    merged = after_merging(rule_with(CHARITABLE), belief)
    assert merged.components.track_id.tolist() == [2]
    assert merged.components.unseen_s.tolist() == [0.0]


@pytest.mark.parametrize(("reading", "names"), [("literal", [1, 2]), ("charitable", [2])])
def test_one_that_was_never_confirmed_dies_after_a_second_in_the_charitable_reading(
    reading: str, names: list[int]
) -> None:
    belief = belief_of([spot(30.0, LANE), spot(60.0, LANE)], unseen_s=[1.1, 9.0], confirmed=[False, True])
    assert after_merging(rule_with({"reading": reading}), belief).components.track_id.tolist() == names


def test_a_component_that_weighs_next_to_nothing_keeps_its_particles_where_all_vote_alike() -> None:
    mixture = mixture_at([(30.0, LANE), (32.5, LANE)], std_m=0.3)
    share = np.array([1.0 - 1e-9, 1e-9])
    starved = replace(
        mixture, cloud=replace(mixture.cloud, log_component_weight=np.log(share)[mixture.cloud.component])
    )
    by_weight, alike = (
        recluster(
            starved,
            component_moments(starved),
            PaperReclustering(lon_m=3.0, lat_m=1.2, alike=alike),
            np.random.default_rng(0),
        )[0]
        for alike in (False, True)
    )
    assert component_moments(alike).mean[LON] == pytest.approx([30.0, 32.5], abs=0.1)
    assert np.bincount(by_weight.cloud.component).tolist() != [400, 400]
    assert np.bincount(alike.cloud.component).tolist() == [400, 400]


@pytest.mark.parametrize("update", ["joint", "max_likelihood"])
def test_a_detection_on_the_ego_itself_starts_no_component(update: str) -> None:
    options = FilterOptions.model_validate({"update": update, "particles": 50})
    tracker = MixtureTracker(ROAD, SensorModel(), motion_model("cvm"), np.random.default_rng(0), options)
    ego = ego_at()
    for time_s in (0.0, 0.1):
        tracker.step(scan_of(time_s, [(ego.lon_m + 1.0, ego.lat_m - 0.5), (30.0, LANE)], ego))
        assert len(tracker.mixture) == 1
