import numpy as np
import pytest

from harness.trackers.stonesoup.stitching import IdentityStitcher, LastSightings, StitchingOptions
from mmpf.tracks import CONFIRMED, HIDDEN, Tracks
from tests.mmpf import scenes


def tracks_of(rows: list[tuple[int, float, float, float, int]]) -> Tracks:
    """Rows of (id, lon, lat, std_lon, state), all at 20 m/s."""
    number, lon, lat, std_lon, state = np.array(rows).reshape(-1, 5).T
    return scenes.tracks_of(lon, lat, track_id=number, std_lon_m=std_lon, state=state, std_speed_mps=0.5)


Row = tuple[int, float, float, float, int]
COASTING, NEAR = (1, 140.0, 5.0, 1.5, HIDDEN), (2, 143.0, 5.0, 0.3, CONFIRMED)


def sightings(first_s: list[float], last_s: list[float]) -> LastSightings:
    return LastSightings(np.array(first_s, dtype=float), np.array(last_s, dtype=float))


def hide_track_1(stitcher: IdentityStitcher) -> None:
    stitcher.stitch(tracks_of([(1, 100.0, 5.0, 0.2, CONFIRMED)]), sightings([0.0], [1.0]), 1.0)


def test_a_new_track_at_a_coasting_one_takes_its_identity_and_the_old_one_goes():
    stitcher = IdentityStitcher(StitchingOptions())
    hide_track_1(stitcher)
    both = tracks_of([(1, 140.0, 5.0, 1.5, HIDDEN), (2, 144.0, 5.3, 0.3, CONFIRMED)])
    stitched, replaced = stitcher.stitch(both, sightings([0.0, 2.8], [1.0, 3.0]), 3.0)
    assert stitched.track_id.tolist() == [1]
    assert stitched.lon_m.tolist() == [144.0]
    assert replaced.tolist() == [1]
    alone = tracks_of([(2, 146.0, 5.3, 0.3, CONFIRMED)])
    assert stitcher.stitch(alone, sightings([2.8], [3.1]), 3.1)[0].track_id.tolist() == [1]


@pytest.mark.parametrize(("remember_s", "identity"), [(StitchingOptions().remember_s, 1), (2.0, 2)])
def test_a_new_track_where_an_ended_one_would_be_takes_its_identity_while_it_is_remembered(remember_s, identity):
    stitcher = IdentityStitcher(StitchingOptions(remember_s=remember_s))
    hide_track_1(stitcher)
    stitcher.stitch(tracks_of([]), sightings([], []), 2.0)
    new = tracks_of([(2, 161.0, 5.0, 0.3, CONFIRMED)])
    assert stitcher.stitch(new, sightings([3.8], [4.0]), 4.0)[0].track_id.tolist() == [identity]


@pytest.mark.parametrize(
    ("old", "new", "seen"),
    [
        pytest.param(COASTING, (2, 144.0, 8.7, 0.3, CONFIRMED), ([0.0, 2.8], [1.0, 3.0]), id="in the next lane"),
        pytest.param(COASTING, (2, 160.0, 5.0, 0.3, CONFIRMED), ([0.0, 2.8], [1.0, 3.0]), id="too far ahead"),
        pytest.param((1, 140.0, 5.0, 0.3, CONFIRMED), NEAR, ([0.0, 2.8], [3.0, 3.0]), id="the old one is still seen"),
        pytest.param(COASTING, NEAR, ([0.0, 1.0], [2.7, 3.0]), id="the old one was seen long after it began"),
    ],
)
def test_a_new_track_that_is_another_vehicle_keeps_its_own_identity(old: Row, new: Row, seen: tuple[list[float], ...]):
    stitcher = IdentityStitcher(StitchingOptions())
    hide_track_1(stitcher)
    stitched, replaced = stitcher.stitch(tracks_of([old, new]), sightings(*seen), 3.0)
    assert stitched.track_id.tolist() == [1, 2]
    assert replaced.tolist() == []


def test_one_lost_identity_goes_to_the_nearer_of_two_new_tracks():
    stitcher = IdentityStitcher(StitchingOptions())
    hide_track_1(stitcher)
    three = tracks_of([(1, 140.0, 5.0, 1.5, HIDDEN), (2, 145.0, 5.0, 0.3, CONFIRMED), (3, 141.0, 5.0, 0.3, CONFIRMED)])
    stitched, _ = stitcher.stitch(three, sightings([0.0, 2.8, 2.8], [1.0, 3.0, 3.0]), 3.0)
    assert stitched.track_id.tolist() == [2, 1]
