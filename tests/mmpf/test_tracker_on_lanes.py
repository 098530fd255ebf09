"""The filter on a crossing: oncoming, crossing and turning vehicles, and one that turns while nobody sees it."""

from collections.abc import Iterator

import numpy as np
import pytest

from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.road import Road
from mmpf.motion import motion_model
from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import FilterOptions
from mmpf.scan import EgoPose, Scan, SensorModel
from mmpf.tracker import MixtureTracker
from mmpf.tracks import HIDDEN, Tracks
from tests.mmpf.map.scenes import arc, graph_of
from tests.mmpf.scenes import detections_at

ARM_M, EDGE_M, SIDE_M, NOISE_M = 100.0, 8.0, 1.6, 0.15


def crossing() -> Road:
    def leg(*ends: tuple[float, float]) -> FloatArray:
        return np.array(ends)

    lines = {
        "from west": leg((-ARM_M, -SIDE_M), (-EDGE_M, -SIDE_M)),
        "to east": leg((EDGE_M, -SIDE_M), (ARM_M, -SIDE_M)),
        "from east": leg((ARM_M, SIDE_M), (EDGE_M, SIDE_M)),
        "to west": leg((-EDGE_M, SIDE_M), (-ARM_M, SIDE_M)),
        "to north": leg((SIDE_M, EDGE_M), (SIDE_M, ARM_M)),
        "from north": leg((-SIDE_M, ARM_M), (-SIDE_M, EDGE_M)),
        "to south": leg((-SIDE_M, -EDGE_M), (-SIDE_M, -ARM_M)),
        "eastward": leg((-EDGE_M, -SIDE_M), (EDGE_M, -SIDE_M)),
        "westward": leg((EDGE_M, SIDE_M), (-EDGE_M, SIDE_M)),
        "southward": leg((-SIDE_M, EDGE_M), (-SIDE_M, -EDGE_M)),
        "left turn": np.add((-EDGE_M, -SIDE_M), arc(EDGE_M + SIDE_M, np.pi / 2, 20)),
    }
    links = [
        *(("from west", "eastward"), ("eastward", "to east"), ("from east", "westward"), ("westward", "to west")),
        *(
            ("from north", "southward"),
            ("southward", "to south"),
            ("from west", "left turn"),
            ("left turn", "to north"),
        ),
    ]
    inner = ("eastward", "westward", "southward", "left turn")
    return LaneGraphRoad(graph=graph_of(lines, links, in_junction=inner))


ROAD = crossing()
WAYS = {
    "turning": (("from west", "left turn", "to north"), 30.0, 8.0),
    "oncoming": (("from east", "westward", "to west"), 20.0, 12.0),
    "crossing": (("from north", "southward", "to south"), 20.0, 10.0),
}


def place(name: str, time_s: float) -> tuple[float, float]:
    graph = ROAD.graph
    lanes, begin_m, speed_mps = WAYS[name]
    along_m = begin_m + speed_mps * time_s
    for lane in lanes:
        index = graph.name.index(lane)
        if along_m < graph.length_m[index]:
            break
        along_m -= graph.length_m[index]
    x, y, _ = graph.place(np.array([index]), np.array([along_m]), np.zeros(1))
    return float(x[0]), float(y[0])


def track_ids(tracks: Tracks, at: tuple[float, float], within_m: float = 2.0) -> list[int]:
    near = (np.hypot(tracks.lon_m - at[0], tracks.lat_m - at[1]) < within_m) & (tracks.state > 0)
    return [int(number) for number in tracks.track_id[near]]


def follow(model: str, unseen: tuple[float, float]) -> Iterator[tuple[float, Tracks]]:
    """Yield time and tracks; the turning vehicle gives no detections between the times ``unseen``, as behind a wall.

    The filter knows nothing of the wall, so that it believes less and less in the vehicle: it is to report it anyway.
    """
    rng = np.random.default_rng(0)
    options = FilterOptions.model_validate({"particles": 500, "reporting": {"reported_hidden_above": 0.0}})
    sensor = SensorModel(range_m=200.0, clutter_per_scan=0.1)
    tracker = MixtureTracker(ROAD, sensor, motion_model(model), np.random.default_rng(1), options)
    ego = EgoPose(-90.0, -SIDE_M, 0.0, 0.0, 4.7, 1.9)
    for k in range(115):
        time_s = 0.1 * k
        hidden = unseen[0] < time_s < unseen[1]
        places = np.array([place(name, time_s) for name in WAYS if not (hidden and name == "turning")])
        x, y = places.T + NOISE_M * rng.standard_normal(places.T.shape)
        found = detections_at(list(zip(x, y, strict=True)), NOISE_M, NOISE_M)
        yield time_s, tracker.step(Scan(time_s, found, ego))


@pytest.mark.parametrize("model", ["cvm", *(pytest.param(other, marks=pytest.mark.slow) for other in ("idm", "gmm"))])
def test_oncoming_crossing_and_turning_vehicles_are_followed_with_their_speeds(model: str) -> None:
    numbers: dict[str, set[int]] = {name: set() for name in WAYS}
    for time_s, tracks in follow(model, (99.0, 99.0)):
        for name in WAYS:
            found = track_ids(tracks, place(name, time_s))
            if time_s > 1.5:
                assert len(found) == 1, (name, time_s)
                numbers[name].add(found[0])
            if time_s > 3.0:
                speed = tracks.speed_mps[tracks.track_id == found[0]]
                assert speed == pytest.approx([WAYS[name][2]], abs=1.2), (name, time_s)
    assert [len(each) for each in numbers.values()] == [1, 1, 1]


@pytest.mark.slow
def test_a_vehicle_that_turns_unseen_is_known_again_on_the_way_that_it_took() -> None:
    before, after = set(), set()
    for time_s, tracks in follow("cvm", (6.5, 8.6)):
        found = track_ids(tracks, place("turning", time_s))
        if 4.0 < time_s < 6.4:
            before.update(found)
        if 6.8 < time_s < 8.6:
            assert (tracks.state == HIDDEN).sum() == 1
            x, y = tracks.lon_m[tracks.state == HIDDEN][0], tracks.lat_m[tracks.state == HIDDEN][0]
            on_a_way = abs(y + SIDE_M) < 1.0 or abs(np.hypot(x + EDGE_M, y - EDGE_M) - (EDGE_M + SIDE_M)) < 1.0
            assert on_a_way or abs(x - SIDE_M) < 1.0, "between the ways there is no road"
        if time_s > 9.5:
            after.update(found)
    assert len(before) == 1
    assert before == after
