"""The lane-change model is trained on the very inputs that it is given in use."""

from dataclasses import replace

import numpy as np

from harness.lab.fit.change_fit import LINE_COLUMNS, change_samples
from harness.lab.windows.cases import lane_change_cases
from harness.lab.windows.changing import lane_change_windows
from mmpf.motion.learned.lane_changer import FURTHEST_NEIGHBOUR_M, change_inputs, view_of
from mmpf.motion.state import LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED
from tests.harness.lab.windows.test_windows import ROAD, STEP_S, changing, steady, traffic


def test_inputs_in_training_and_in_use_are_the_same():
    recording = traffic(
        (0.0, 10.0, changing(150)), (30.0, 9.0, steady(2.0)), (40.0, 11.0, steady(6.0)), (-20.0, 10.5, steady(6.0))
    )
    changes = lane_change_windows(recording, ROAD)
    x, y = change_samples(changes, np.random.default_rng(0), 0.0)
    cases = lane_change_cases(changes, 1, np.random.default_rng(0))
    exact = [column for column in range(14) if column not in LINE_COLUMNS]
    for step in (0, 30, 49, 52, 80):
        state = cases.truth[step]
        around = cases.surroundings(state, step, False)
        crossed = state[LAT] > 2.0
        view = view_of(around, state[SPEED], np.ones(1), crossed)
        used = change_inputs(state, np.ones(1), np.zeros(1), np.full(1, 2.0), view)
        known = [c for c in exact if not (crossed[0] and c in (7, 12))]
        np.testing.assert_allclose(used[0, known], x[step, known], atol=1e-9)
        assert abs(used[0, 9] - x[step, 9]) < 1.0
    np.testing.assert_allclose(y[:, 1], np.diff(changes.state[LON, 0]), atol=1e-9)


def test_a_missing_neighbour_scatters_about_the_furthest_distance():
    changes = lane_change_windows(traffic((0.0, 10.0, changing(150))), ROAD)
    x, _ = change_samples(changes, np.random.default_rng(0), 0.0)
    assert abs(x[:, 6].mean() - FURTHEST_NEIGHBOUR_M) < 5.0
    assert x[:, 6].std() > 1.0


def test_a_sample_moved_sideways_goes_on_with_the_recorded_acceleration():
    recorded_without_speed = lane_change_windows(traffic((0.0, 10.0, changing(150))), ROAD)
    state = recorded_without_speed.state.copy()
    state[LAT_SPEED] = np.gradient(state[LAT], STEP_S, axis=1)
    changes = replace(recorded_without_speed, states=state.swapaxes(0, 1))
    x, y = change_samples(changes, np.random.default_rng(0), 1.0)
    recorded = changes.state[:, 0]
    np.testing.assert_allclose(y[:, 2] - x[:, 2], np.diff(recorded[LAT_SPEED]), atol=1e-9)
    np.testing.assert_allclose(y[:, 4], recorded[LAT_ACCEL, 1:], atol=1e-9)
    faster = x[:, 2] - recorded[LAT_SPEED, :-1]
    np.testing.assert_allclose(y[:, 0] - np.diff(recorded[LAT]), STEP_S * faster, atol=1e-9)
    assert (x[:, 0] != recorded[LAT, :-1]).all()


def test_only_the_asked_share_of_the_samples_is_moved_and_none_of_them_forward():
    changes = lane_change_windows(traffic((0.0, 10.0, changing(150))), ROAD)
    x, _ = change_samples(changes, np.random.default_rng(0), 0.3)
    moved = x[:, 0] != changes.state[LAT, 0, :-1]
    assert 0.1 < moved.mean() < 0.5
    np.testing.assert_array_equal(x[:, 1], changes.state[LON, 0, :-1])
    np.testing.assert_array_equal(x[:, 3], changes.state[SPEED, 0, :-1])
