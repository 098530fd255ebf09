"""What stands still amid moving traffic is tentative, whatever tracker reports it, but not a vehicle that braked."""

from dataclasses import replace

import numpy as np
import pytest

from harness.trackers.catalogue import available_trackers, build_tracker, tracker_options
from harness.trackers.doubtful import DoubtfulOptions, DoubtingTracker
from harness.trackers.protocol import TrackerSetting
from harness.trackers.track_options import TrackOptions, factory
from mmpf.map.corridor_road import CorridorRoad, highway
from mmpf.scan import Detections, EgoPose, Scan, SensorModel
from mmpf.tracks import CONFIRMED, HIDDEN, TENTATIVE, Tracks
from tests.mmpf.scenes import detections_at, ego_at, tracks_of

EGO = EgoPose(0.0, 0.0, 0.0, 20.0, 4.7, 1.9)
NOBODY = Detections(*[np.zeros(0)] * 6)
OPTIONS = DoubtfulOptions(on=True)
OTHERS = [(20.0, 3.6, 20.0), (-20.0, 3.6, 21.0), (50.0, -3.6, 19.0)]
STANDS, MOVES = (40.0, 3.6, 0.0), (40.0, 3.6, 20.0)


def tracks_at(places: list[tuple[float, float, float]], std_speed: float = 0.3, state: int = CONFIRMED) -> Tracks:
    """Return tracks of identities from 1 on, each with its place along and across the road and its speed."""
    lon, lat, speed = np.array(places).reshape(-1, 3).T
    return tracks_of(lon, lat, speed_mps=speed, std_speed_mps=std_speed, state=state)


class Scripted:
    """A tracker that reports what is written down."""

    def __init__(self, script: list[Tracks]) -> None:
        self._script = iter(script)

    def step(self, scan: Scan) -> Tracks:
        return next(self._script)


def states_of_first(
    script: list[Tracks], options: DoubtfulOptions = OPTIONS, ego: EgoPose = EGO, in_plane: bool = False
) -> list[int]:
    """Return the state of the first track after each scan."""
    tracker = DoubtingTracker(Scripted(script), options, in_plane)
    return [int(tracker.step(Scan(0.1 * k, NOBODY, ego)).state[0]) for k in range(len(script))]


@pytest.mark.parametrize("state", [CONFIRMED, HIDDEN, TENTATIVE])
def test_what_stands_amid_moving_traffic_is_tentative(state):
    amid = replace(tracks_at([STANDS, *OTHERS]), state=np.array([state, *[CONFIRMED] * 3], dtype=np.int8))
    assert states_of_first([amid] * 3) == [TENTATIVE] * 3


def test_the_others_stay_as_they_are():
    before = tracks_at([STANDS, *OTHERS])
    after = DoubtingTracker(Scripted([before]), OPTIONS).step(Scan(0.0, NOBODY, EGO))
    assert after.state.tolist() == [TENTATIVE, CONFIRMED, CONFIRMED, CONFIRMED]
    assert after.lon_m.tolist() == before.lon_m.tolist()


@pytest.mark.parametrize(
    "places",
    [
        [MOVES, *OTHERS],
        [STANDS, (20.0, 3.6, 1.0), (-20.0, 3.6, 0.0), (50.0, -3.6, 3.0)],
        [STANDS, OTHERS[0]],
        [STANDS, *((lon + 300.0, lat, speed) for lon, lat, speed in OTHERS)],
    ],
    ids=["it moves", "all stand", "one other", "others are far"],
)
def test_nothing_is_doubtful_without_standing_amid_flow(places):
    assert states_of_first([tracks_at(places)] * 3) == [CONFIRMED] * 3


def test_doubtful_tracks_do_not_tell_how_traffic_flows():
    three_stand = [STANDS, (45.0, 7.2, 0.0), (60.0, 7.2, 0.0), *OTHERS, (70.0, 3.6, 20.0), (80.0, 3.6, 20.0)]
    jam = [STANDS, (45.0, 7.2, 0.0), (60.0, 7.2, 0.0), *OTHERS[:2]]
    # Two of four others flow: their median speed is 10 m/s; once the other two are doubtful it is 20.
    options = OPTIONS.model_copy(update={"flow_mps": 15.0})
    assert states_of_first([tracks_at(three_stand), tracks_at(jam)], options) == [TENTATIVE, TENTATIVE]
    assert states_of_first([tracks_at(jam)], options) == [CONFIRMED]


def test_a_vehicle_that_was_seen_to_move_may_brake_and_stand():
    moving, standing = tracks_at([MOVES, *OTHERS]), tracks_at([STANDS, *OTHERS])
    # The first scan tells of no time; after ten more it has moved for a second.
    assert states_of_first([moving] * 11 + [standing] * 3)[-3:] == [CONFIRMED] * 3
    assert states_of_first([moving] * 9 + [standing] * 3)[-3:] == [TENTATIVE] * 3


def test_a_speed_that_is_hardly_known_is_no_motion():
    unsure, standing = tracks_at([MOVES, *OTHERS], std_speed=10.0), tracks_at([STANDS, *OTHERS])
    assert states_of_first([unsure] * 15 + [standing])[-1] == TENTATIVE
    assert states_of_first([unsure]) == [CONFIRMED]
    assert states_of_first([unsure], OPTIONS.model_copy(update={"standing_std": 2.0})) == [TENTATIVE]


def test_what_has_been_followed_for_long_is_trusted():
    options = OPTIONS.model_copy(update={"trusted_after_s": 2.0})
    states = states_of_first([tracks_at([STANDS, *OTHERS])] * 25, options)
    assert states == [TENTATIVE] * 20 + [CONFIRMED] * 5


@pytest.mark.parametrize(
    ("lon", "lat", "state"),
    [(40.0, 1.0, CONFIRMED), (40.0, 2.5, TENTATIVE), (-40.0, 1.0, TENTATIVE), (101.0, 1.0, TENTATIVE)],
)
def test_what_stands_in_the_path_of_the_ego_is_always_reported(lon, lat, state):
    # A heading within the lane does not turn the path away from the road.
    for heading in (0.0, 0.1):
        script = [tracks_at([(lon, lat, 0.0), *OTHERS, (90.0, 3.6, 20.0)])]
        assert states_of_first(script, ego=replace(EGO, heading_rad=heading)) == [state]


def test_in_the_plane_the_path_leads_along_the_heading():
    script = [tracks_at([(1.0, 40.0, 0.0), *OTHERS])]
    assert states_of_first(script, ego=replace(EGO, heading_rad=0.5 * np.pi), in_plane=True) == [CONFIRMED]
    assert states_of_first(script, in_plane=True) == [TENTATIVE]


def test_off_the_tracker_is_left_as_it_is():
    setting = TrackerSetting(CorridorRoad(lanes=()), SensorModel(), np.random.default_rng(0))
    amid = tracks_at([STANDS, *OTHERS])
    assert factory(TrackOptions, lambda *_: Scripted([amid]))(setting, {}).step(Scan(0.0, NOBODY, EGO)) is amid


RIVALS = sorted(set(available_trackers()) - {"mmpf", "oracle-kalman", "detections"})


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow if "jpda" in n else ()) for n in RIVALS])
def test_every_rival_has_the_rule_as_an_option(name):
    """Three vehicles drive at 20 m/s, something beside their lane stands: it alone is tentative."""
    if name == "lmb":
        pytest.importorskip("multisensor_lmb_filters_rs")
    assert not tracker_options(name)().doubtful.on
    road, lateral = highway(), [1.8, 5.5, 9.1]
    rng = np.random.default_rng(0)

    def last(options: dict[str, object]) -> Tracks:
        tracker = build_tracker(
            name, TrackerSetting(road, SensorModel(), np.random.default_rng(1)), options, tuned=False
        )
        for k in range(30):
            lon = np.array([*(220.0 + 20.0 * 0.1 * k + np.array([10.0, 25.0, -15.0])), 270.0])
            lat = np.array([*lateral, lateral[0] + 7.0])
            noisy = np.stack([lon, lat]) + 0.1 * rng.standard_normal((2, 4))
            found, ego = detections_at(noisy.T.tolist(), 0.2, 0.2), ego_at(220.0 + 2.0 * k, lateral[1] - 20.0)
            tracks = tracker.step(Scan(0.1 * k, found, ego))
        return tracks

    for on, withheld in ((False, 0), (True, 1)):
        tracks = last({"doubtful": {"on": on}})
        assert len(tracks) == 4
        stands = np.abs(tracks.speed_mps) < 2.0
        assert stands.sum() == 1
        assert (tracks.state[stands] == TENTATIVE).sum() == withheld
        assert (tracks.state[~stands] != TENTATIVE).all()
