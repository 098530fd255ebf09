"""Traffic from SUMO: kinematics, density, egos, determinism, and what happens with wrong input."""

import itertools
from collections import Counter
from contextlib import closing, nullcontext
from dataclasses import fields, replace

import numpy as np
import pytest

from harness.common.errors import InputError, RunError
from harness.truth.frame import Frame
from harness.truth.network.network import load_network
from harness.truth.sumo.simulation import open_traffic


def drive(demand=12.0, duration_s=8.0, seed=1, **options):
    us101 = load_network("us101")
    with closing(open_traffic(us101, demand=demand, duration_s=duration_s, seed=seed, **options)) as truth:
        return list(truth.frames())


@pytest.fixture(scope="module")
def frames():
    return drive(demand=25.0)


def pairs(frames):
    """Yield rows of the same vehicles, on lanes, in each frame and the next."""
    for before, after in itertools.pairwise(frames):
        _, first, second = np.intersect1d(before.vehicle_id, after.vehicle_id, return_indices=True)
        on_lane = (before.lane[first] > 0) & (after.lane[second] > 0)
        yield before, after, first[on_lane], second[on_lane]


def test_frames_come_every_step_and_as_many_as_asked_for(frames):
    assert [frame.step for frame in frames] == list(range(80))
    assert np.allclose([frame.time_s for frame in frames], np.arange(80) * 0.1)


def test_position_is_the_integral_of_speed_along_and_across_the_road(frames):
    for before, after, a, b in pairs(frames):
        along = 0.05 * (before.speed_mps[a] + after.speed_mps[b])
        assert np.allclose(after.lon_m[b] - before.lon_m[a], along, atol=0.01)
        assert np.allclose(after.lat_m[b] - before.lat_m[a], 0.1 * after.lat_speed_mps[b], atol=0.02)


def test_nothing_jumps(frames):
    check_that_nothing_jumps_along_the_road(frames)
    check_that_nothing_jumps_sideways(frames)


def check_that_nothing_jumps_along_the_road(frames):
    for before, after, a, b in pairs(frames):
        assert np.abs(after.accel_mps2[b] - before.accel_mps2[a]).max() < 2.0
    for frame in frames:
        assert np.abs(frame.accel_mps2).max() < 9.0


def check_that_nothing_jumps_sideways(frames):
    for before, after, a, b in pairs(frames):
        assert np.abs(after.lat_speed_mps[b] - before.lat_speed_mps[a]).max() < 0.6


def test_vehicles_never_overlap(frames):
    check_that_vehicles_never_overlap(frames)


def check_that_vehicles_never_overlap(frames):
    for frame in frames[::5]:
        gap_lon = np.abs(frame.lon_m[:, None] - frame.lon_m) - 0.5 * (frame.length_m[:, None] + frame.length_m)
        gap_lat = np.abs(frame.lat_m[:, None] - frame.lat_m) - 0.5 * (frame.width_m[:, None] + frame.width_m)
        overlap = (gap_lon < 0.0) & (gap_lat < 0.0)
        assert np.array_equal(overlap, np.eye(len(frame), dtype=bool))


def test_without_ego_frames_have_none():
    assert all(frame.ego == -1 for frame in drive(demand=5.0, duration_s=1.0, ego=False))


@pytest.mark.slow
def test_another_ego_takes_over_at_the_end_of_the_section():
    frames = drive(demand=5.0, duration_s=35.0, warm_up_s=5.0)
    episodes = np.array([frame.episode for frame in frames])
    egos = [str(frame.vehicle_id[frame.ego]) for frame in frames]
    assert episodes[0] == 0
    assert episodes[-1] >= 1
    assert set(np.diff(episodes)) == {0, 1}
    change = int(np.flatnonzero(np.diff(episodes))[0])
    assert egos[change] != egos[change + 1]
    assert frames[0].lane[frames[0].ego] in {2, 3, 4}
    assert all(0.0 <= frame.lon_m[frame.ego] < 640.0 for frame in frames)


def test_same_seed_same_frames_and_another_seed_others():
    first, second, other = (drive(demand=8.0, duration_s=1.0, seed=seed) for seed in (4, 4, 5))
    assert all(same(a, b) for a, b in zip(first, second, strict=True))
    assert not same(first[-1], other[-1])


def same(a, b):
    return all(np.array_equal(getattr(a, column.name), getattr(b, column.name)) for column in fields(Frame))


@pytest.mark.slow
@pytest.mark.parametrize("density", [5.0, 12.0, 20.0, 30.0, 45.0, 65.0])
def test_the_density_asked_for_is_met_within_a_tenth_and_a_jam_stops_and_goes(density):
    frames = drive(density, duration_s=30.0, seed=3)
    inside = [np.sum((f.lon_m >= 0.0) & (f.lon_m < 640.0) & (f.lane > 0)) for f in frames]
    assert np.mean(inside) / 5 / 0.640 == pytest.approx(density, rel=0.1)
    speeds = np.concatenate([f.speed_mps[(f.lane > 0) & (f.lane < 6)] for f in frames])
    if density > 50.0:
        assert np.mean(speeds < 4.0) > 0.05
        assert np.mean(speeds > 8.0) > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("demand", ["us101-0750", "us101-0805", "us101-0820"])
def test_in_the_calibrated_periods_nothing_jumps_or_overlaps_and_no_lane_is_closed(demand):
    frames = drive(demand=demand, duration_s=40.0, seed=3)
    check_that_nothing_jumps_along_the_road(frames)
    check_that_vehicles_never_overlap(frames)
    stood = Counter()
    for frame in frames:
        stood.update(str(name) for name in frame.vehicle_id[(frame.lane > 0) & (frame.speed_mps < 0.1)])
    assert max(stood.values(), default=0) < 200  # of 400 steps
    # SUMO pushes a car aside faster than its type's maxSpeedLat.
    with pytest.raises(AssertionError) if demand == "us101-0805" else nullcontext():
        check_that_nothing_jumps_sideways(frames)


def test_nothing_is_written_to_the_screen(capfd):
    drive(demand=5.0, duration_s=0.2)
    assert capfd.readouterr() == ("", "")


def test_closing_twice_is_harmless_and_two_at_once_are_refused():
    network = load_network("us101")
    truth = open_traffic(network, demand=5.0, duration_s=1.0, seed=0, warm_up_s=0.0)
    with pytest.raises(RunError, match="one at a time"):
        open_traffic(network, demand=5.0, duration_s=1.0, seed=0)
    truth.close()
    truth.close()
    open_traffic(network, demand=5.0, duration_s=1.0, seed=0, warm_up_s=0.0).close()


@pytest.fixture
def own_network(tmp_path):
    """Return a function that writes a configuration of the user's own and returns its path."""

    def write(route="approach upstream auxiliary downstream outflow", vehicles=3):
        net_file = load_network("us101").net_file
        flow = f'<flow id="f" route="r" begin="0" end="60" number="{vehicles}" departSpeed="20"/>'
        (tmp_path / "own.rou.xml").write_text(f'<routes><route id="r" edges="{route}"/>{flow}</routes>')
        (tmp_path / "own.sumocfg").write_text(
            f'<configuration><net-file value="{net_file}"/><route-files value="own.rou.xml"/></configuration>'
        )
        return str(tmp_path / "own.sumocfg")

    return write


def test_a_configuration_of_the_users_own_yields_its_own_traffic(own_network):
    truth = open_traffic(load_network(own_network()), duration_s=2.0, seed=0, warm_up_s=0.0)
    frames = list(truth.frames())
    truth.close()
    assert len(frames) == 20
    assert all(str(name).startswith("f.") for name in frames[0].vehicle_id)
    assert frames[0].lane[frames[0].ego] > 0


def test_a_route_over_unknown_edges_is_one_clear_line(own_network):
    network = load_network(own_network(route="nowhere"))
    with pytest.raises((InputError, RunError)) as error:
        open_traffic(network, duration_s=1.0, seed=0)
    assert "\n" not in str(error.value)


def test_a_named_demand_on_a_network_with_its_own_is_refused(own_network):
    with pytest.raises(InputError, match="`demand`"):
        open_traffic(load_network(own_network()), demand="jam", duration_s=1.0, seed=0)


def test_a_missing_route_file_is_named(own_network, tmp_path):
    path = own_network()
    (tmp_path / "own.rou.xml").unlink()
    with pytest.raises(InputError, match=r"own\.rou\.xml"):
        load_network(path)


def test_a_road_without_traffic_fails_in_words(own_network, monkeypatch):
    monkeypatch.setattr("harness.truth.sumo.plane_traffic.FIRST_VEHICLE_WITHIN_S", 5.0)
    network = replace(load_network(own_network(vehicles=0)), name="empty")
    with pytest.raises((InputError, RunError), match=r"empty|number"):
        open_traffic(network, duration_s=1.0, seed=0, warm_up_s=0.0)
