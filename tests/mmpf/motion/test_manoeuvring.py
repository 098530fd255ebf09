"""Manoeuvres that no model foresees: who begins them, who goes on with them, and what a filter gains by them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmpf.motion.kinematic import HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2
from mmpf.motion.manoeuvring import HOLDS, Manoeuvring
from mmpf.motion.protocol import motion_models
from mmpf.motion.state import ACCEL, SPEED
from mmpf.options.filter import FilterOptions
from mmpf.scan import SensorModel
from mmpf.tracker import MixtureTracker
from mmpf.tracks import CONFIRMED
from tests.mmpf.motion.surroundings import around, states
from tests.mmpf.scenes import ROAD, ego_at, lane_centre, scan_of

DT_S, BEGIN_PER_S, TRUE_PER_S, MEAN_S = 0.1, 0.5, 0.05, 2.0


def manoeuvring(inner: str = "cvm", begin_per_s: float = BEGIN_PER_S, mean_s: float = MEAN_S) -> Manoeuvring:
    return Manoeuvring(motion_models[inner](), begin_per_s, TRUE_PER_S, mean_s, accel_std_mps2=3.0)


@pytest.mark.parametrize("inner", ["cvm", "cam", "idm", "gmm"])
def test_whom_nobody_sees_the_inner_model_drives(inner: str) -> None:
    state = states(200)
    model, alone = manoeuvring(inner), motion_models[inner]()
    latents = model.draw_latents(state, np.random.default_rng(1))
    hidden = around(state, hidden=True)
    moved, carried = model.propagate(state, latents, hidden, DT_S, np.random.default_rng(2))
    expected, kept = alone.propagate(state, latents[:HOLDS], hidden, DT_S, np.random.default_rng(2))
    np.testing.assert_array_equal(moved, expected)
    np.testing.assert_array_equal(carried[:HOLDS], kept)
    assert not carried[HOLDS].any()


def test_the_share_in_a_manoeuvre_settles_where_as_many_begin_as_end() -> None:
    state = states(20_000)
    model, rng = manoeuvring(), np.random.default_rng(0)
    latents = model.draw_latents(state, rng)
    for _ in range(100):
        _, latents = model.propagate(state, latents, around(state), DT_S, rng)
    begins, ends = -np.expm1(-DT_S * BEGIN_PER_S), -np.expm1(-DT_S / MEAN_S)
    assert latents[HOLDS].mean() == pytest.approx(begins / (begins + ends), abs=0.02)


def test_a_manoeuvre_holds_its_acceleration() -> None:
    state, rng = states(1000), np.random.default_rng(0)
    model = manoeuvring(begin_per_s=1e9, mean_s=1e9)
    first, latents = model.propagate(state, model.draw_latents(state, rng), around(state), DT_S, rng)
    second, _ = model.propagate(first, latents, around(first), DT_S, rng)
    assert latents[HOLDS].all()
    assert first[ACCEL].std() > 2.0
    np.testing.assert_array_equal(second[ACCEL], first[ACCEL])
    np.testing.assert_allclose(second[SPEED] - first[SPEED], DT_S * first[ACCEL])


@given(st.floats(-30.0, 30.0), st.floats(0.0, 40.0), st.integers(0, 99))
def test_no_manoeuvre_reverses_or_asks_for_more_than_tyres_and_engines_give(
    accel_mps2: float, speed_mps: float, seed: int
) -> None:
    state, rng = states(50, speed_mps), np.random.default_rng(seed)
    state[ACCEL] = accel_mps2
    model = manoeuvring(begin_per_s=1e9)
    moved, _ = model.propagate(state, model.draw_latents(state, rng), around(state), DT_S, rng)
    assert (moved[SPEED] >= 0.0).all()
    assert (moved[ACCEL] >= -HARDEST_BRAKING_MPS2).all()
    assert (moved[ACCEL] <= STRONGEST_ACCEL_MPS2).all()


def braking_car(manoeuvres: dict[str, float], seed: int, model: str = "gmm") -> tuple[list[int], float]:
    """A car ahead brakes by 6 m/s² to a stop among cars that go on: its confirmed tracks' names, and worst speed error.

    The error is that of the last seconds of its braking.
    """
    options = FilterOptions.model_validate({"particles": 500, "joint": {"manoeuvres": manoeuvres}})
    rng = np.random.default_rng(seed)
    tracker = MixtureTracker(ROAD, SensorModel(), motion_models[model](), rng, options)
    noise = np.random.default_rng(seed + 100)
    place_m, speed_mps, names, worst = 30.0, 20.0, [], 0.0
    for step in range(80):
        place_m += DT_S * speed_mps
        speed_mps = max(speed_mps - (6.0 * DT_S if step >= 30 else 0.0), 0.0)
        beside = [(2.0 * step + away, lane_centre(lane)) for away, lane in ((-20.0, 1), (25.0, 0), (60.0, 3), (5.0, 4))]
        seen = [(lon + 0.2 * noise.standard_normal(), lat) for lon, lat in [(place_m, lane_centre(2)), *beside]]
        tracks = tracker.step(scan_of(DT_S * step, seen, ego_at(lon_m=min(2.0 * step, 40.0 + step))))
        at_it = (np.abs(tracks.lon_m - place_m) < 4.0) & (np.abs(tracks.lat_m - lane_centre(2)) < 1.0)
        here = np.flatnonzero(at_it & (tracks.state == CONFIRMED))
        if step >= 20:
            names += tracks.track_id[here].tolist() or [0]
        if 40 <= step < 63 and len(here):
            worst = max(worst, float(np.abs(tracks.speed_mps[here] - speed_mps).max()))
    return sorted(set(names)), worst


@pytest.mark.parametrize("seed", range(4))
def test_a_car_in_sight_that_brakes_as_nobody_foresaw_stays_one_track_that_knows_its_speed(seed: int) -> None:
    names, worst_mps = braking_car({}, seed)
    assert len(names) == 1
    assert names != [0]
    assert worst_mps < 2.5
