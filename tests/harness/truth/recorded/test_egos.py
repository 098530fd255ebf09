"""Which recorded vehicle carries the sensor, and where the record of the road ends."""

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.truth.recorded.source import open_recorded_traffic
from harness.truth.recorded.traffic import recorded_window
from tests.harness.truth.recorded.layouts import Car, ngsim_rows, write_ngsim_csv

FLEET = (
    Car(1, 300.0, 9.0, 10.0, from_s=0.0, to_s=4.0),
    Car(2, 320.0, 5.0, 10.0, from_s=0.5, to_s=6.0),
    Car(3, 310.0, 12.0, 10.0, from_s=5.0, to_s=12.0),
    Car(4, 280.0, 12.0, 10.0, from_s=3.0, to_s=5.0),
)


def truth_of(tmp_path, ego: str, cars=FLEET):
    path = write_ngsim_csv(tmp_path / "scene.csv", ngsim_rows(cars))
    return open_recorded_traffic(path, "ngsim", "us101", ego, 60.0)


def test_auto_hands_the_sensor_to_whoever_stays_longest_when_its_vehicle_is_gone(tmp_path):
    truth = truth_of(tmp_path, "auto")
    names = [str(truth.traffic.names[ego.stay]) for ego in truth.egos]
    assert names == ["1", "2", "3"]
    frames = list(truth.frames())
    assert [frame.step for frame in frames] == list(range(truth.expected_steps))
    changes = np.flatnonzero(np.diff([frame.episode for frame in frames]))
    # Car 1 until 4.0 s, then car 2 until 6.0 s, then car 3.
    assert changes.tolist() == [40, 60]
    for frame in frames:
        assert str(frame.vehicle_id[frame.ego]) == names[frame.episode]


def test_each_takes_every_vehicle_in_turn_that_stays_for_three_seconds(tmp_path):
    truth = truth_of(tmp_path, "each")
    assert [str(truth.traffic.names[ego.stay]) for ego in truth.egos] == ["1", "2", "3"]
    frames = list(truth.frames())
    assert len(frames) == 41 + 56 + 71
    np.testing.assert_allclose(np.diff([frame.time_s for frame in frames]), 0.1)
    for ego, episode in (("1", 0), ("2", 1), ("3", 2)):
        of_ego = [frame for frame in frames if frame.episode == episode]
        assert {str(frame.vehicle_id[frame.ego]) for frame in of_ego} == {ego}


def test_a_named_vehicle_carries_the_sensor_for_as_long_as_it_is_on_record(tmp_path):
    truth = truth_of(tmp_path, "4")
    frames = list(truth.frames())
    assert len(frames) == 21
    assert {str(frame.vehicle_id[frame.ego]) for frame in frames} == {"4"}


@pytest.mark.parametrize(
    ("ego", "cars", "told"),
    [("9", {}, r"`ego` 9: .* 1, 2, 3, 4"), ("each", {"cars": (Car(1, 30.0, 9.0, 10.0, to_s=2.0),)}, "`ego` each")],
)
def test_an_ego_that_is_not_on_record_or_not_for_long_enough_is_refused(ego, cars, told, tmp_path):
    with pytest.raises(InputError, match=told):
        truth_of(tmp_path, ego, **cars)


def test_the_window_ends_where_vehicles_usually_vanish_and_not_where_one_strays():
    """Five vehicles vanish at 100 m while the recording goes on, one goes on to 130 m."""
    stays = [np.linspace(10.0 * k, 100.0, 20 + k) for k in range(5)] + [np.linspace(0.0, 130.0, 60)]
    lon = np.concatenate(stays)
    stay = np.repeat(np.arange(6), [len(positions) for positions in stays])
    step = np.concatenate([np.arange(len(positions)) for positions in stays])
    assert recorded_window(step, stay, lon) == (0.0, 100.0)


def test_a_window_without_comings_and_goings_is_as_long_as_the_traffic():
    lon = np.concatenate([np.linspace(5.0, 50.0, 10), np.linspace(20.0, 70.0, 10)])
    assert recorded_window(np.tile(np.arange(10), 2), np.repeat([0, 1], 10), lon) == (5.0, 70.0)


@pytest.mark.parametrize(("ego", "names"), [("each:1", ["1"]), ("each:2", ["1", "3"]), ("each:9", ["1", "2", "3"])])
def test_some_of_each_are_evenly_spaced_and_never_more_than_there_are(ego, names, tmp_path):
    truth = truth_of(tmp_path, ego)
    assert [str(truth.traffic.names[stay.stay]) for stay in truth.egos] == names
    assert f"{len(names)} in turn" in truth.report()
