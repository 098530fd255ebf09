"""The learned driver: it follows, keeps its lane, has habits, changes lanes, and reads only sound files."""

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

from mmpf.motion.gmm.model_file import ModelFileError, load_arrays, save_arrays
from mmpf.motion.learned.driver import HABIT, INTENTION, TARGET, LearnedDriver, load_learned_driver
from mmpf.motion.learned.lane_changer import CHANGE
from mmpf.motion.learned.short_driver import load_short_driver, short_term_driver
from mmpf.motion.state import LAT, LAT_SPEED, LON, SPEED
from tests.mmpf.motion.surroundings import around, in_lanes, states, vehicle

STEP_S = 0.1


def drive(model, state, steps, leader_speed, leader_lon=30.0, hidden=True):
    rng = np.random.default_rng(0)
    latents = model.draw_latents(state, rng)
    for _ in range(steps):
        gap = np.full(state.shape[1], leader_lon) - state[LON]
        seen = vehicle(state.shape[1], 0.0, leader_speed)
        seen = type(seen)(seen.exists, gap, seen.speed_mps, seen.accel_mps2, seen.length_m)
        state, latents = model.propagate(state, latents, around(state, seen, hidden=hidden), STEP_S, rng)
        leader_lon += leader_speed * STEP_S
    return state, latents, leader_lon


def test_it_takes_up_the_leaders_speed_without_running_into_it():
    state, _, leader = drive(LearnedDriver(changes_lanes=False), states(500, 20.0), 300, 12.0)
    assert state[SPEED].mean() == pytest.approx(12.0, abs=0.5)
    assert (leader - state[LON] > 0.0).mean() > 0.95


def test_it_stops_behind_a_standing_leader():
    state, _, leader = drive(LearnedDriver(changes_lanes=False), states(200, 8.0), 300, 0.0, leader_lon=60.0)
    assert state[SPEED].mean() < 0.5
    assert 0.0 < np.median(leader - state[LON]) < 8.0


def test_a_hidden_particle_keeps_its_driver_and_a_seen_one_gets_a_new_one_now_and_then():
    model, rng = LearnedDriver(changes_lanes=False), np.random.default_rng(0)
    state = states(2000)
    ahead = vehicle(2000, 25.0, 20.0)
    _, first = model.propagate(state, model.draw_latents(state, rng), around(state, ahead), STEP_S, rng)
    _, hidden = model.propagate(state, first, around(state, ahead, hidden=True), STEP_S, rng)
    _, seen = model.propagate(state, first, around(state, ahead), STEP_S, rng)
    np.testing.assert_array_equal(first[HABIT], hidden[HABIT])
    assert 0.005 < (first[HABIT] != seen[HABIT]).mean() < 0.05


@pytest.mark.parametrize("dt_s", [0.05, 0.1, 0.2, 1.0])
def test_free_acceleration_spreads_alike_at_any_length_of_the_step(dt_s):
    """As an AR(1) process, whose variance is that of its noise over 1 - (1 - approach)²."""
    fitted = LearnedDriver().model.free
    step = fitted.driving(dt_s)
    variance = fitted.accel_noise_mps2**2 / (1.0 - (1.0 - 0.1 * fitted.lag_per_s) ** 2)
    assert step.noise_mps2**2 / (1.0 - (1.0 - step.approach) ** 2) == pytest.approx(variance)


def test_lane_keepers_stay_in_their_lane():
    state, _, _ = drive(LearnedDriver(changes_lanes=False), states(300, 20.0), 200, 20.0)
    assert (np.abs(state[LAT] - 2.0) < 1.5).mean() > 0.97


@pytest.mark.parametrize("lat_speed_mps", [0.0, 0.8])
def test_a_vehicle_on_a_ramp_keeps_its_speed_and_its_course(lat_speed_mps):
    model, rng = LearnedDriver(), np.random.default_rng(0)
    state = states(2000, 20.0, lat_m=-6.0)
    state[LAT_SPEED] = lat_speed_mps
    latents = model.draw_latents(state, rng)
    for _ in range(20):
        state, latents = model.propagate(state, latents, around(state, on_road=False), STEP_S, rng)
    assert state[SPEED].mean() == pytest.approx(20.0, abs=0.5)
    assert state[LAT].mean() == pytest.approx(-6.0 + 2.0 * lat_speed_mps, abs=0.1)


def test_a_driver_who_means_to_change_ends_up_in_the_next_lane():
    model, rng = LearnedDriver(), np.random.default_rng(0)
    state = states(400, 20.0)
    latents = model.draw_latents(state, rng)
    ever = np.zeros(400, dtype=bool)
    for _ in range(200):
        state, latents = model.propagate(state, latents, in_lanes(state), STEP_S, rng)
        ever |= latents[INTENTION] != 0.0
    keeping = latents[INTENTION] == 0.0
    from_centre = np.abs((state[LAT] - 2.0 + 2.0) % 4.0 - 2.0)
    assert ever.mean() > 0.3
    assert (np.abs(state[LAT, ever & keeping] - 2.0) > 2.0).sum() > 10
    assert (from_centre[keeping] < 1.5).mean() > 0.9
    assert (np.abs(state[LAT, ~ever] - 2.0) < 1.5).all()


def test_most_changes_that_are_begun_are_finished():
    model, rng = LearnedDriver(), np.random.default_rng(0)
    state = states(500, 20.0)
    _, latents = model.propagate(state, model.draw_latents(state, rng), around(state), STEP_S, rng)
    latents[INTENTION], latents[TARGET] = 1.0, 6.0
    for _ in range(150):
        state, latents = model.propagate(state, latents, in_lanes(state), STEP_S, rng)
    assert (state[LAT] > 4.0).mean() > 0.8


def test_a_truck_counts_by_its_bumper_not_by_its_middle():
    model = short_term_driver()
    state = states(4000, 20.0)
    car = around(state, vehicle(4000, 25.0, 18.0, length_m=4.6))
    truck = around(state, vehicle(4000, 20.4, 18.0, length_m=9.2))
    behind_car, _ = model.propagate(state, np.empty((0, 4000)), car, STEP_S, np.random.default_rng(1))
    behind_truck, _ = model.propagate(state, np.empty((0, 4000)), truck, STEP_S, np.random.default_rng(1))
    np.testing.assert_allclose(behind_car, behind_truck, atol=1e-9)


@pytest.fixture
def own_file(tmp_path):
    path = tmp_path / "own.npz"
    path.write_bytes(files("mmpf.models").joinpath("lane_keeping.npz").read_bytes())
    return path


def test_a_model_file_of_the_users_own_is_read(own_file):
    assert load_learned_driver(own_file).model.follower.following.mixture.inputs == 6


def refuses(load, path, words):
    with pytest.raises(ModelFileError, match=words) as refusal:
        load(path)
    assert "\n" not in str(refusal.value)
    assert path.name in str(refusal.value)


def test_what_is_no_such_model_is_refused(own_file, tmp_path):
    refuses(load_learned_driver, tmp_path / "none.npz", "does not exist")
    refuses(load_short_driver, own_file, "not for lane-keeping-short")
    refuses(CHANGE.load, own_file, "not for lane-change")
    arrays = load_arrays(own_file, "lane-keeping")
    nowhere = np.full_like(arrays["following.means"], np.nan)
    for wrong, words in ((nowhere, "not finite"), (np.zeros((28, 5)), "shape")):
        save_arrays(own_file, arrays | {"following.means": wrong})
        refuses(load_learned_driver, own_file, words)
    own_file.write_bytes(own_file.read_bytes()[:500])
    refuses(load_learned_driver, own_file, "damaged or no npz")


def test_committed_models_are_smaller_than_a_megabyte():
    sizes = {
        entry.name: len(entry.read_bytes()) for entry in files("mmpf.models").iterdir() if entry.name.endswith(".npz")
    }
    assert sizes
    assert max(sizes.values()) < 1_000_000


def test_where_several_have_room_side_by_side_a_vehicle_keeps_its_own_place_and_not_the_middle():
    state = states(500, 20.0, lat_m=3.0)
    wide = around(state)
    wide = replace(wide, lane_right_m=np.zeros(500), lane_left_m=np.full(500, 18.0))
    model, rng = LearnedDriver(changes_lanes=False), np.random.default_rng(0)
    latents = model.draw_latents(state, rng)
    for _ in range(100):
        state, latents = model.propagate(state, latents, wide, STEP_S, rng)
    assert state[LAT].mean() == pytest.approx(3.0, abs=0.2)
