"""The joint rule stage by stage: existence, weights, births, removals, confirmation, against formulas by hand."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.joint.rule import JointUpdate
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import FilterOptions
from mmpf.scan import BodySizes, SensorModel
from mmpf.stages.update_rule import Occlusion, Situation, Updated
from tests.mmpf.scenes import belief_of, detections_at, ego_at, lane_centre, spot
from tests.mmpf.test_update_rules import situation_with

PARTICLES = 30
PLACE = (30.0, lane_centre(2))
CLUTTER_DENSITY = 1.0 / 4000.0
BIRTH = 0.3
LARGEST = FilterOptions().joint.existence.largest
Place = tuple[float, float]


IMMORTAL = {"death_rate_per_s": 0.0}
FOREVER_S = 1e12
ALONE = {"exclusion_per_s": 0.0}


def rule_with(**groups: dict[str, object]) -> JointUpdate:
    """The joint rule without resampling but for what its groups of settings say."""
    usual = {
        "association": {"birth_density": BIRTH},
        "resampling": {"effective_share": 0.0, "young_s": 0.0},
        # Vehicles on which shadows have their whole effect stay so.
        "vehicles": {"shading_s": FOREVER_S},
    }
    joint = {name: usual.get(name, {}) | groups.get(name, {}) for name in usual | groups}
    return JointUpdate(FilterOptions.model_validate({"particles": PARTICLES, "joint": joint}), SensorModel())


def cloud_at(place: Place, seed: int = 0) -> FloatArray:
    state = spot(*place, particles=PARTICLES)
    state[[LON, LAT]] += np.array([[0.5], [0.2]]) * np.random.default_rng(seed).standard_normal((2, PARTICLES))
    return state


def likelihood(state: FloatArray, place: Place) -> FloatArray:
    """f(z | x) of ``detections_at``, whose deviations are 0.3 and 0.2 m."""
    return np.asarray(norm.pdf(place[0], state[LON], 0.3) * norm.pdf(place[1], state[LAT], 0.2))


def updated(
    rule: JointUpdate,
    prior: Mixture,
    detected: FloatArray,
    detections: list[Place],
    dt_s: float = 0.1,
    run: float = 0.0,
) -> Updated:
    occlusion = Occlusion(detected, *[np.full(len(prior), run)] * 2)
    situation = replace(situation_with(detections), dt_s=dt_s)
    return rule.measurement_update(prior, component_moments(prior), occlusion, situation, np.random.default_rng(0))


def finetuned(rule: JointUpdate, mixture: Mixture) -> Mixture:
    moments = component_moments(mixture)
    return rule.finetune(mixture, moments, situation_with([]), np.random.default_rng(0)).mixture


def uneven(low: float, high: float, components: int = 1) -> FloatArray:
    """Probabilities that differ from particle to particle."""
    return np.tile(np.linspace(low, high, PARTICLES), components)


@given(existence=st.floats(0.01, 0.99), detected=st.floats(0.05, 0.95))
@settings(max_examples=25, deadline=None)
def test_a_missed_component_exists_as_probably_as_the_two_hypotheses_say(existence: float, detected: float) -> None:
    prior = belief_of([cloud_at(PLACE)], existence=[existence])
    every = np.full(PARTICLES, detected)
    after = updated(rule_with(existence=IMMORTAL, association=ALONE), prior, every, [])
    expected = existence * (1.0 - detected) / (1.0 - existence * detected)
    assert after.mixture.components.existence == pytest.approx([expected])
    assert after.mixture.components.hits.tolist() == [1]


@pytest.mark.parametrize("away_m", [0.4, 1.6, 2.2, 2.5])
@pytest.mark.parametrize("existence", [0.05, 0.3, 0.9])
def test_one_detection_raises_existence_as_much_as_its_three_explanations_say(away_m: float, existence: float) -> None:
    """The detection is the component's, clutter, or a newborn vehicle; its probability differs between particles."""
    state, place = cloud_at(PLACE), (PLACE[0] + away_m, PLACE[1])
    detected = uneven(0.2, 0.9)
    after = updated(
        rule_with(existence=IMMORTAL, association=ALONE | {"gate_std": 50.0}),
        belief_of([state], existence=[existence]),
        detected,
        [place],
    )
    its_own = existence * float((detected * likelihood(state, place)).mean()) / CLUTTER_DENSITY
    exists_unseen = existence * float((1.0 - detected).mean()) * (1.0 + BIRTH)
    exists_not = (1.0 - existence) * (1.0 + BIRTH)
    total = its_own + exists_unseen + exists_not
    assert after.mixture.components.existence == pytest.approx([min((its_own + exists_unseen) / total, LARGEST)])
    assert after.birth_claim == pytest.approx([(exists_unseen + exists_not) / total])
    assert after.mixture.components.hits.tolist() == [1 + (its_own / total > 0.5)]


def test_two_components_and_two_detections_exist_nearly_as_by_enumeration() -> None:
    places = [PLACE, (PLACE[0] + 1.5, PLACE[1])]
    detections = [(PLACE[0] + 1.6, PLACE[1]), (PLACE[0] - 2.4, PLACE[1])]
    states = [cloud_at(place, seed) for seed, place in enumerate(places)]
    detected, existence = np.full(2 * PARTICLES, 0.8), np.array([0.5, 0.4])
    after = updated(
        rule_with(existence=IMMORTAL, association=ALONE | {"gate_std": 50.0}),
        belief_of(states, existence=existence.tolist()),
        detected,
        detections,
    )
    mass, exists = 0.0, np.zeros(2)
    for choice in product(("nothing", "unseen", 0, 1), repeat=2):
        used = [word for word in choice if isinstance(word, int)]
        if len(set(used)) < len(used):
            continue
        weight = (1.0 + BIRTH) ** (2 - len(used))
        for m, word in enumerate(choice):
            if word == "nothing":
                weight *= 1.0 - existence[m]
            elif word == "unseen":
                weight *= existence[m] * 0.2
            else:
                density = likelihood(states[m], detections[word]).mean()
                weight *= existence[m] * 0.8 * density / CLUTTER_DENSITY
        mass += weight
        exists += weight * np.array([word != "nothing" for word in choice])
    assert after.mixture.components.existence == pytest.approx(np.minimum(exists / mass, LARGEST), abs=0.02)


@pytest.mark.parametrize("dt_s", [0.05, 0.1, 0.3, 1.0])
def test_the_chance_to_have_left_grows_with_the_time_between_scans(dt_s: float) -> None:
    prior, nothing = belief_of([cloud_at(PLACE)], existence=[0.8]), np.zeros(PARTICLES)
    after = updated(rule_with(existence={"death_rate_per_s": 1.05}), prior, nothing, [], dt_s, run=1.0)
    assert after.mixture.components.existence == pytest.approx([0.8 * np.exp(-1.05 * dt_s)])


@pytest.mark.parametrize("dt_s", [0.05, 0.1, 0.4])
def test_what_a_hidden_particle_loses_beside_a_seen_vehicle_grows_with_the_time_between_scans(dt_s: float) -> None:
    hidden = np.concatenate([spot(*PLACE, particles=10), spot(90.0, lane_centre(4), particles=20)], axis=1)
    prior = belief_of([hidden, spot(*PLACE, particles=10)], confirmed=[True, True], unseen_s=[2.0, 0.0])
    nothing = np.zeros(40)
    after = updated(rule_with(association={"exclusion_per_s": 9.0}), prior, nothing, [], dt_s).mixture.cloud
    lost = np.exp(-9.0 * dt_s)
    factor = np.array([lost] * 10 + [1.0] * 30)
    assert after.log_raw_weight - prior.cloud.log_raw_weight == pytest.approx(np.log(factor), abs=1e-9)
    assert np.exp(after.log_weight[:30]) == pytest.approx(factor[:30] / (10.0 * lost + 20.0), rel=1e-9)


@pytest.mark.parametrize("exclusive", [True, False])
def test_particles_are_weighed_by_the_miss_and_by_what_the_detection_says_for_them(exclusive: bool) -> None:
    state, place = cloud_at(PLACE), (PLACE[0] + 0.8, PLACE[1])
    weight = np.random.default_rng(5).dirichlet(np.ones(PARTICLES))
    detected = uneven(0.2, 0.9)
    rule = rule_with(association=ALONE | {"gate_std": 50.0, "exclusive": exclusive})
    after = updated(rule, belief_of([state], [weight]), detected, [place]).mixture.cloud
    offered = likelihood(state, place) / CLUTTER_DENSITY / (1.0 + BIRTH)
    expected = weight * (1.0 - detected + detected * offered)
    assert np.exp(after.log_weight) == pytest.approx(expected / expected.sum())


def test_a_detection_that_serves_two_vehicles_is_no_less_than_no_false_detection() -> None:
    both = belief_of([cloud_at(PLACE), cloud_at(PLACE)], confirmed=[True, True], hits=[9, 9])
    rule = rule_with(association={"exclusive": False})
    told = updated(rule, both, np.full(2 * PARTICLES, 0.9), [PLACE]).false_detections
    assert told == pytest.approx(0.0, abs=0.1)
    assert told >= 0.0


def test_hits_are_counted_and_the_time_unseen_starts_anew_with_each() -> None:
    prior = belief_of([cloud_at(PLACE), cloud_at((-30.0, 5.0))], hits=[4, 5], unseen_s=[0.7, 0.7])
    every = np.full(2 * PARTICLES, 0.5)
    components = updated(rule_with(), prior, every, [PLACE]).mixture.components
    assert components.hits.tolist() == [5, 5]
    assert components.unseen_s == pytest.approx([0.0, 0.8])


def test_a_hit_component_takes_the_size_of_the_detection_that_is_most_probably_its_own() -> None:
    sizes = BodySizes(np.array([9.0, 5.0]), np.array([2.5, 1.8]), np.array([1.0, 1.0]), np.array([0.2, 0.2]))
    detections = replace(detections_at([(PLACE[0] + 40.0, PLACE[1]), PLACE]), sizes=sizes)
    prior = belief_of([cloud_at(PLACE)])
    situation = situation_with([])
    situation = replace(situation, scan=replace(situation.scan, detections=detections))
    every = np.full(PARTICLES, 0.5)
    occlusion, rng = Occlusion(every, np.zeros(1), np.zeros(1)), np.random.default_rng(0)
    after = rule_with().measurement_update(prior, component_moments(prior), occlusion, situation, rng)
    known = prior.components
    expected = np.average([known.length_m[0], 5.0], weights=[known.std_length_m[0] ** -2, 1.0])
    assert after.mixture.components.length_m == pytest.approx([expected])


def test_without_shadows_every_particle_has_the_fixed_probability() -> None:
    prior = belief_of([cloud_at(PLACE), cloud_at((60.0, PLACE[1]))])
    rule = rule_with(detectability={"shadow": False, "fixed_probability": 0.7, "run_share": 0.0})
    occlusion = rule.assert_occlusion(prior, component_moments(prior), situation_with([]))
    assert occlusion.detection_probability == pytest.approx(np.full(2 * PARTICLES, 0.7))
    assert occlusion.run_probability == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize(("existence", "hidden"), [(0.9, True), (0.1, False)])
def test_only_what_probably_exists_hides_what_stands_behind_it(existence: float, hidden: bool) -> None:
    behind = belief_of([spot(15.0, lane_centre(2)), spot(40.0, lane_centre(2))], existence=[existence, 0.9])
    rule = rule_with(detectability={"run_share": 0.0})
    occlusion = rule.assert_occlusion(behind, component_moments(behind), situation_with([]))
    assert occlusion.detection_probability[:10] == pytest.approx(np.full(10, 0.95))
    assert occlusion.detection_probability[10:] == pytest.approx(np.full(10, 0.02 if hidden else 0.95))


def test_particles_in_view_lose_less_weight_where_a_run_of_misses_has_lasted() -> None:
    prior, run, lasting = belief_of([cloud_at(PLACE)]), 0.3, 0.8
    detected = (1.0 - run) * np.where(np.arange(PARTICLES) < 20, 0.9, 0.05)
    occlusion = Occlusion(detected, np.array([run]), np.array([lasting]))
    moments, rule, rng = component_moments(prior), rule_with(association=ALONE), np.random.default_rng(0)
    after = rule.measurement_update(prior, moments, occlusion, situation_with([]), rng)
    weight = [lasting + (1.0 - lasting) * (1.0 - seen) for seen in detected / (1.0 - run)]
    assert np.exp(after.mixture.cloud.log_weight) == pytest.approx(np.array(weight) / sum(weight))
    sources = after.mixture.components
    assert sources.missed == pytest.approx([run / (1.0 - detected.mean())])
    assert sources.unexplained == pytest.approx([lasting / np.mean(weight)])


def test_a_run_lasts_on_for_longer_the_longer_it_has_lasted() -> None:
    prior = belief_of([cloud_at(PLACE)] * 2, missed=[1.0, 1.0], unexplained=[1.0, 1.0], unseen_s=[0.1, 3.0])
    occlusion = rule_with().assert_occlusion(prior, component_moments(prior), situation_with([]))
    assert occlusion.run_probability[0] < occlusion.lasting_probability[0] < occlusion.lasting_probability[1]


def changed(mixture: Mixture, situation: Situation, claims: list[float], **groups: dict[str, object]) -> Mixture:
    updated = Updated(mixture, np.array(claims), 0.0, 1.0)
    change = rule_with(**groups).remove_add_merge(updated, situation, np.random.default_rng(0))
    anew = component_moments(change.mixture)
    assert (change.moments.mean == anew.mean).all()
    assert (change.moments.variance == anew.variance).all()
    assert len(change.mixture) == len(mixture) - change.removed - change.merged + change.added
    return change.mixture


def test_a_detection_that_nothing_explains_starts_a_component_as_probable_as_births_are_beside_clutter() -> None:
    claims = [0.95, 0.29, 0.31]
    detections = [(30.0, lane_centre(1)), (50.0, lane_centre(1)), (70.0, lane_centre(1))]
    mixture = changed(belief_of([]), situation_with(detections), claims, association={"birth_unexplained": 0.3})
    assert mixture.components.existence == pytest.approx([BIRTH / (1.0 + BIRTH) * claim for claim in (0.95, 0.31)])
    assert component_moments(mixture).mean[LON] == pytest.approx([30.0, 70.0], abs=0.5)


def test_detections_on_the_ego_itself_start_no_component() -> None:
    ego = ego_at()
    on_it = [(0.0, 0.0), (2.3, 0.9), (-2.3, -0.9), (2.4, 0.0), (0.0, 1.0)]
    situation = situation_with([(ego.lon_m + lon, ego.lat_m + lat) for lon, lat in on_it])
    mixture = changed(belief_of([]), situation, [1.0] * len(on_it))
    assert len(mixture) == 2, "the ego is 4.7 m long and 1.9 m wide: the last two lie beside it"


@pytest.mark.parametrize(
    ("column", "kept", "removed"),
    [
        ({"confirmed": [False]}, {"existence": [0.021]}, {"existence": [0.019]}),
        ({"confirmed": [False]}, {"unseen_s": [0.95]}, {"unseen_s": [1.05]}),
        ({"confirmed": [True]}, {"unseen_s": [9.9]}, {"unseen_s": [10.1]}),
    ],
    ids=["existence", "unconfirmed and unseen", "confirmed and unseen"],
)
def test_what_hardly_exists_or_was_not_seen_for_long_is_removed(
    column: dict[str, list[float]], kept: dict[str, list[float]], removed: dict[str, list[float]]
) -> None:
    for case, count in ((kept, 1), (removed, 0)):
        mixture = belief_of([cloud_at(PLACE)], **(column | case))
        assert len(changed(mixture, situation_with([]), [])) == count


@pytest.mark.parametrize(("lon_m", "count"), [(103.0, 1), (105.0, 0)])
def test_what_left_the_observation_area_is_removed(lon_m: float, count: int) -> None:
    assert SensorModel().range_m == 100.0
    assert len(changed(belief_of([spot(lon_m, ego_at().lat_m)]), situation_with([]), [])) == count


@pytest.mark.parametrize(("std_m", "count"), [(19.0, 1), (21.0, 0)])
def test_what_may_be_anywhere_is_removed(std_m: float, count: int) -> None:
    state = spot(30.0, 5.0, particles=2)
    state[LON] += [-std_m, std_m]
    assert len(changed(belief_of([state]), situation_with([]), [])) == count


@pytest.mark.parametrize(
    ("existence", "detected_s", "confirmed"),
    [(0.61, 0.2, True), (0.59, 0.8, False), (0.99, 0.1, False), (0.99, 0.2, True)],
)
def test_a_component_is_confirmed_once_it_is_probable_and_was_detected_for_long_enough(
    existence: float, detected_s: float, confirmed: bool
) -> None:
    mixture = belief_of([cloud_at(PLACE)], existence=[existence], detected_s=[detected_s])
    after = finetuned(rule_with(), mixture)
    assert after.components.confirmed.tolist() == [confirmed]


@pytest.mark.parametrize(("stitch", "names"), [(True, [1]), (False, [1, 2])])
def test_one_confirmed_where_a_hidden_one_may_be_is_that_one_unless_told_otherwise(
    stitch: bool, names: list[int]
) -> None:
    hidden = spot(30.0, 5.0, particles=2)
    hidden[LON] += [-3.0, 3.0]
    mixture = belief_of(
        [hidden, spot(32.0, 5.0)],
        confirmed=[True, False],
        unseen_s=[2.0, 0.0],
        detected_s=[2.9, 0.2],
        existence=[0.9, 0.9],
    )
    after = finetuned(rule_with(identity={"stitch": stitch}), mixture)
    assert after.components.track_id.tolist() == names
    assert after.components.confirmed.all()


def test_each_components_weight_is_its_share_of_all_vehicles_that_are_expected() -> None:
    existence = [0.9, 0.3, 0.6]
    mixture = belief_of([cloud_at(PLACE, seed) for seed in range(3)], existence=existence)
    weighted = rule_with().weight_update(mixture)
    share = np.exp(weighted.cloud.log_component_weight)
    assert share == pytest.approx(np.repeat(np.array(existence) / 1.8, PARTICLES))
    assert (weighted.cloud.log_weight == mixture.cloud.log_weight).all()


def test_a_component_whose_particles_disagree_is_resampled_and_the_others_are_left() -> None:
    lopsided = np.full(PARTICLES, 1e-6)
    lopsided[0] = 1.0 - (PARTICLES - 1) * 1e-6
    states = [cloud_at(PLACE), cloud_at((-30.0, 5.0), 1)]
    prior = belief_of(states, [lopsided, np.full(PARTICLES, 1.0 / PARTICLES)])
    nothing = np.zeros(2 * PARTICLES)
    after = updated(rule_with(resampling={"effective_share": 0.3}), prior, nothing, [])
    assert np.exp(after.mixture.cloud.log_weight) == pytest.approx(np.full(2 * PARTICLES, 1.0 / PARTICLES))
    assert after.mixture.cloud.state[LON, :PARTICLES] == pytest.approx(np.full(PARTICLES, states[0][LON, 0]), abs=0.1)
    assert (after.mixture.cloud.state[:, PARTICLES:] == states[1]).all()
    sizes = [1.0 / (lopsided**2).sum(), PARTICLES]
    assert after.effective_share == pytest.approx(np.mean(sizes) / PARTICLES)


def test_the_entropy_of_the_association_is_that_of_the_hypotheses_of_each_component() -> None:
    state, place = cloud_at(PLACE), (PLACE[0] + 2.2, PLACE[1])
    every = np.full(PARTICLES, 0.5)
    rule = rule_with(existence=IMMORTAL, association=ALONE | {"gate_std": 50.0})
    after = updated(rule, belief_of([state], existence=[0.5]), every, [place])
    its_own = 0.5 * 0.5 * likelihood(state, place).mean() / CLUTTER_DENSITY
    other = (0.5 + 0.5 * 0.5) * (1.0 + BIRTH)
    share = np.array([its_own, other]) / (its_own + other)
    assert after.association_entropy == pytest.approx(-(share * np.log(share)).sum())
