"""Vehicles hidden on purpose: who is hidden when, and that nothing else changes."""

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.config.altered import AlteredSettings
from harness.storage.schema import HIDDEN
from tests.harness.sensor.test_altered import done, film, seen


def withheld(snapshots):
    """Return the length of the window that each vehicle is in, shape (snapshots, vehicles); nobody enters or leaves."""
    return np.array([snapshot.observation.pseudo_hidden_s for snapshot in snapshots])


def windows(lengths):
    """Return length and number of snapshots of each window of one vehicle, by a plain loop."""
    found, run = [], 0
    for k, length in enumerate(lengths):
        run = run + 1 if length else 0
        if length and (k + 1 == len(lengths) or not lengths[k + 1]):
            found.append((length, run))
    return found


@pytest.fixture(scope="module")
def snapshots():
    return film(200, speed=10.0, car_speed_mps=10.0)


@pytest.fixture(scope="module")
def hidden(snapshots):
    return done(snapshots, hide_s=(1.0, 2.0), hide_share=0.3)


def test_a_hidden_vehicle_gives_no_detection_and_counts_as_hidden(hidden):
    for snapshot in hidden:
        chosen = snapshot.observation.pseudo_hidden_s > 0.0
        names = set(snapshot.frame.vehicle_id[chosen].tolist())
        assert not names & set(snapshot.observation.truth_id.tolist())
        assert (snapshot.observation.state[chosen] == HIDDEN).all()
        assert (snapshot.observation.visible_fraction[chosen] == 0.0).all()


def test_all_other_vehicles_are_detected_as_before(snapshots, hidden):
    for before, after in zip(snapshots, hidden, strict=True):
        names = set(after.frame.vehicle_id[after.observation.pseudo_hidden_s > 0.0].tolist())
        assert [name for name in before.observation.truth_id if name not in names] == list(after.observation.truth_id)
        assert after.frame is before.frame


def test_each_window_lasts_as_long_as_it_says(hidden):
    for lengths in withheld(hidden[:-25]).T:
        for length, count in windows(lengths)[:-1]:
            assert count == round(length / 0.1)


def test_both_lengths_occur_and_each_vehicle_is_two_seconds_in_view_before(hidden):
    table = withheld(hidden)
    assert set(np.unique(table)) == {0.0, 1.0, 2.0}
    for lengths in table.T:
        begins = np.flatnonzero((lengths[1:] > 0.0) & (lengths[:-1] == 0.0)) + 1
        for begin in begins:
            assert begin >= 20
            assert not lengths[begin - 20 : begin].any()


def test_no_more_than_the_share_is_hidden_at_one_time(snapshots, hidden):
    most = max(1, int(0.3 * len(seen(snapshots))))
    assert (withheld(hidden) > 0.0).sum(axis=1).max() <= most


def test_standing_vehicles_are_never_hidden():
    assert not withheld(done(film(60, car_speed_mps=0.0), hide_s=(1.0,))).any()


def test_the_same_seed_hides_the_same_vehicles(snapshots, hidden):
    assert (withheld(done(snapshots, hide_s=(1.0, 2.0))) == withheld(hidden)).all()
    assert (withheld(done(snapshots, seed=1, hide_s=(1.0, 2.0))) != withheld(hidden)).any()


def test_times_may_be_given_as_a_list_with_commas():
    assert AlteredSettings(hide_s="1,2.5").hide_s == (1.0, 2.5)
    with pytest.raises(InputError, match="`hide`"):
        AlteredSettings(hide_s="1,two")
