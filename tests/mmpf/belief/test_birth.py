"""New components: where their particles are drawn, what they are given, and names that no other ever had."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmpf.belief.birth import Births, Traffic, give_birth
from mmpf.belief.mixture import Components, Mixture
from mmpf.motion.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import MEAN_CAR, BirthOptions, FilterOptions, Footprint
from mmpf.scan import BodySizes, Detections
from tests.mmpf.scenes import LinearGaussianMotion, belief_of, detections_at, spot

PARTICLES = 20_000
PLACES = [(30.0, 5.0), (-20.0, 9.0)]
STEADY = Traffic(np.array([0.0]), np.array([20.0]))


@dataclass(frozen=True)
class HabitMotion(LinearGaussianMotion):
    """Gives each newborn particle a latent of its own."""

    latent_size: int = 1

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        return 2.0 * state[[LON]]


def born(
    detections: Detections | None = None,
    mixture: Mixture | None = None,
    keep: list[bool] | None = None,
    chosen: list[int] | None = None,
    existence: list[float] | None = None,
    traffic: Traffic = STEADY,
    particles: int = PARTICLES,
    vehicle: Footprint = MEAN_CAR,
    **options: Any,
) -> Mixture:
    detections = detections if detections is not None else detections_at(PLACES)
    mixture = mixture if mixture is not None else belief_of([])
    chosen = chosen if chosen is not None else list(range(len(detections)))
    return give_birth(
        mixture,
        np.array(keep if keep is not None else [True] * len(mixture), dtype=np.bool_),
        Births(
            detections,
            np.array(chosen, dtype=np.int64),
            type(mixture.components).newborn(
                mixture.new_track_ids(len(chosen)),
                np.array(existence if existence is not None else [0.2] * len(chosen)),
                vehicle,
            ),
            traffic,
        ),
        LinearGaussianMotion(),
        FilterOptions(particles=particles, birth=BirthOptions(**options)),
        np.random.default_rng(3),
    )


def rows_of(mixture: Mixture, m: int) -> FloatArray:
    return mixture.cloud.state[:, mixture.cloud.component == m]


def assert_normal(values: FloatArray, mean: float, std: float) -> None:
    assert values.mean() == pytest.approx(mean, abs=5.0 * std / np.sqrt(len(values)))
    assert values.std() == pytest.approx(std, rel=0.03)


def test_particles_lie_around_their_detection_as_widely_as_it_was_measured() -> None:
    mixture = born(detections_at(PLACES, std_lon_m=0.5, std_lat_m=0.25), lat_speed_std_mps=0.4, accel_std_mps2=0.7)
    assert len(mixture) == 2
    for m, (lon_m, lat_m) in enumerate(PLACES):
        own = rows_of(mixture, m)
        assert own.shape == (6, PARTICLES)
        assert_normal(own[LON], lon_m, 0.5)
        assert_normal(own[LAT], lat_m, 0.25)
        assert_normal(own[LAT_SPEED], 0.0, 0.4)
        assert_normal(own[ACCEL], 0.0, 0.7)
        assert (own[LAT_ACCEL] == 0.0).all()
        assert np.abs(np.corrcoef(own[:5]) - np.eye(5)).max() < 0.04


def test_particles_lie_aslant_around_a_detection_whose_noise_is_correlated() -> None:
    slanting = replace(detections_at(PLACES, std_lon_m=0.5, std_lat_m=0.25), correlation=np.array([0.9, -0.6]))
    mixture = born(slanting)
    for m in range(2):
        covariance = np.cov(rows_of(mixture, m)[[LON, LAT]])
        assert covariance == pytest.approx(slanting.covariance_m2[m], rel=0.05)


def test_a_measured_speed_is_taken_whatever_the_traffic_does() -> None:
    measured = replace(detections_at(PLACES), speed_mps=np.array([31.0, np.nan]), std_speed_mps=np.array([0.8, np.nan]))
    mixture = born(measured, local_speed_share=1.0, local_speed_std_mps=2.5, standing_share=0.0)
    assert_normal(rows_of(mixture, 0)[SPEED], 31.0, 0.8)
    assert_normal(rows_of(mixture, 1)[SPEED], 20.0, 2.5)


def test_a_speed_that_was_not_measured_is_that_of_the_traffic_around_the_nearer_the_more() -> None:
    traffic = Traffic(np.array([0.0, 60.0, 4000.0]), np.array([15.0, 27.0, 5.0]))
    mixture = born(
        detections_at([(20.0, 5.0)]), traffic=traffic, local_speed_share=1.0, local_range_m=40.0, standing_share=0.0
    )
    weight = np.exp(-0.5 * (np.array([20.0, 40.0]) / 40.0) ** 2)
    assert_normal(rows_of(mixture, 0)[SPEED], float(weight @ [15.0, 27.0] / weight.sum()), 2.5)


def test_some_speeds_are_drawn_from_everything_that_is_possible() -> None:
    def speeds(local_speed_share: float) -> FloatArray:
        widths = {"local_speed_std_mps": 1.0, "other_speed_std_mps": 4.0, "standing_share": 0.0}
        return rows_of(born(detections_at([(0.0, 5.0)]), local_speed_share=local_speed_share, **widths), 0)[SPEED]

    wide, mixed = speeds(0.0), speeds(0.6)
    assert_normal(wide, 20.0, 4.0)
    assert_normal(mixed, 20.0, np.sqrt(0.6 * 1.0**2 + 0.4 * 4.0**2))


@pytest.mark.parametrize("local_speed_share", [0.0, 0.6, 1.0])
def test_some_particles_stand_however_fast_the_traffic_flows(local_speed_share: float) -> None:
    narrow = {"local_speed_std_mps": 1.0, "other_speed_std_mps": 1.0, "standing_share": 0.25}
    speed = born(detections_at([(0.0, 5.0)]), local_speed_share=local_speed_share, **narrow).cloud.state[SPEED]
    stands = speed < 10.0
    assert stands.mean() == pytest.approx(0.25, abs=0.02)
    assert np.sqrt((speed[stands] ** 2).mean()) == pytest.approx(0.5, rel=0.05)
    assert_normal(speed[~stands], 20.0, 1.0)


@pytest.mark.parametrize(("measured_mps", "std_mps"), [(np.nan, np.nan), (0.5, 2.0)])
def test_nobody_is_born_driving_in_reverse_not_even_in_a_jam(measured_mps: float, std_mps: float) -> None:
    detections = replace(detections_at(PLACES), speed_mps=np.full(2, measured_mps), std_speed_mps=np.full(2, std_mps))
    speed = born(detections, traffic=Traffic(np.array([0.0]), np.array([0.5]))).cloud.state[SPEED]
    assert speed.min() == 0.0
    assert (speed == 0.0).mean() > 0.2


def test_newborn_weights_are_even_and_each_component_expects_as_many_vehicles() -> None:
    mixture = born(mixture=belief_of([spot(0.0, 1.0)] * 3), keep=[True, False, True], particles=50)
    assert mixture.cloud.log_weight[-100:] == pytest.approx(np.full(100, -np.log(50)))
    assert mixture.cloud.log_raw_weight[-100:] == pytest.approx(np.full(100, -np.log(50)))
    assert mixture.cloud.log_component_weight[-100:] == pytest.approx(np.full(100, -np.log(4)))


def test_only_the_chosen_detections_start_a_component_with_the_existence_that_each_was_given() -> None:
    detections = detections_at([(0.0, 1.0), (30.0, 5.0), (60.0, 9.0)])
    mixture = born(detections, chosen=[2, 0], existence=[0.15, 0.23])
    assert mixture.components.existence.tolist() == [0.15, 0.23]
    assert_normal(rows_of(mixture, 0)[LON], 60.0, 0.3)
    assert_normal(rows_of(mixture, 1)[LON], 0.0, 0.3)


def test_a_newborn_component_has_had_one_hit_and_is_confirmed_by_nobody() -> None:
    components = born(particles=10).components
    assert components.hits.tolist() == [1, 1]
    assert components.confirmed.tolist() == [False, False]
    assert components.age_s.tolist() == [0.0, 0.0]
    assert components.unseen_s.tolist() == [0.0, 0.0]


def test_those_that_are_kept_stay_in_front_and_as_they_were() -> None:
    before = belief_of([spot(1.0, 1.0), spot(2.0, 1.0), spot(3.0, 1.0)], track_id=[5, 6, 7], existence=[0.5, 0.6, 0.7])
    mixture = born(mixture=before, keep=[True, False, True], chosen=[1], particles=20)
    assert mixture.components.track_id.tolist() == [5, 7, 100]
    assert mixture.components.existence.tolist() == [0.5, 0.7, 0.2]
    assert np.bincount(mixture.cloud.component).tolist() == [10, 10, 20]
    assert mixture.cloud.state[LON, :20].tolist() == [1.0] * 10 + [3.0] * 10


def test_without_a_detection_to_start_from_those_not_kept_are_let_go_all_the_same() -> None:
    before = belief_of([spot(1.0, 1.0), spot(2.0, 1.0)], track_id=[5, 6])
    assert born(mixture=before, keep=[False, True], chosen=[]).components.track_id.tolist() == [6]


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 7)), min_size=1, max_size=8))
@settings(max_examples=30, deadline=None)
def test_no_name_is_ever_used_again(scans: list[tuple[int, int]]) -> None:
    mixture, ever = belief_of([]), set()
    for births, survivors in scans:
        before = set(mixture.components.track_id.tolist())
        keep = [m < survivors for m in range(len(mixture))]
        mixture = born(detections_at([(0.0, 5.0)] * births), mixture, keep, particles=10)
        names = mixture.components.track_id.tolist()
        fresh = set(names) - before
        assert len(fresh) == births
        assert not fresh & ever
        assert len(set(names)) == len(names)
        ever |= set(names)


def test_a_measured_size_narrows_the_one_that_was_assumed_and_no_size_leaves_it() -> None:
    vehicle = Footprint(length_m=5.0, width_m=2.0, std_length_m=2.0, std_width_m=0.4)
    unmeasured = born(particles=10, vehicle=vehicle).components
    assert unmeasured.length_m.tolist() == [5.0, 5.0]
    assert unmeasured.std_width_m.tolist() == [0.4, 0.4]
    sizes = BodySizes(np.array([4.0, 15.0]), np.array([1.8, 2.6]), np.array([1.0, 1.0]), np.array([0.2, 0.2]))
    measured = born(replace(detections_at(PLACES), sizes=sizes), chosen=[1], particles=10, vehicle=vehicle).components
    assert measured.length_m == pytest.approx([np.average([5.0, 15.0], weights=[1 / 4.0, 1 / 1.0])])
    assert measured.std_length_m == pytest.approx([(1 / 4.0 + 1 / 1.0) ** -0.5])
    assert measured.width_m == pytest.approx([np.average([2.0, 2.6], weights=[0.4**-2, 0.2**-2])])


def test_the_motion_model_gives_each_newborn_particle_its_latents() -> None:
    mixture = give_birth(
        Mixture.empty(1, Components.newborn(np.arange(0), np.zeros(0))),
        np.zeros(0, dtype=np.bool_),
        Births(detections_at(PLACES), np.array([0, 1]), Components.newborn(np.arange(1, 3), np.full(2, 0.2)), STEADY),
        HabitMotion(),
        FilterOptions(particles=10),
        np.random.default_rng(0),
    )
    assert (mixture.cloud.latents == 2.0 * mixture.cloud.state[[LON]]).all()
