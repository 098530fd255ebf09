"""Which cars may be the ego where there is no main road."""

from types import SimpleNamespace

import numpy as np
import pytest

from harness.closedloop.beliefs import believed_by_each
from harness.closedloop.candidates import candidates_of, hidden_second_leader
from harness.closedloop.episode_start import episode_starts
from harness.closedloop.plan import BRAKE, CROSS, FREE
from harness.sensor.profiles import sensor_settings
from harness.truth.network.lanegraph import PlaneNetwork
from mmpf.map.corridor_road import highway
from mmpf.map.graph_road import LaneGraphRoad
from tests.harness.closedloop.frames import frame_of
from tests.harness.closedloop.test_routes import GRAPH, held_at

EAST = 0.0
SENSOR = sensor_settings("lidar", {})


class Standing:
    """Traffic in which every frame is the same but for its number."""

    def __init__(self, graph, lon, routes, speed=10.0, lane=1, past=True):
        names = [f"car{k}" for k in range(len(lon))]
        lanes = np.full(len(lon), lane)
        speeds = np.full(len(lon), speed)
        self.frames = [
            frame_of(lon, np.zeros(len(lon)), speeds, step, names, direction_rad=np.full(len(lon), EAST), lane=lanes)
            for step in range(51)
        ]
        if not past:
            self.frames[0] = frame_of([0.0], [0.0], names=["another"])
        vehicle = SimpleNamespace(getRoute=dict(zip(names, routes, strict=True)).__getitem__)
        self.network = SimpleNamespace(road=LaneGraphRoad(graph=graph), layout=PlaneNetwork(graph, (0.0, 0.0)))
        self.running, self.step_s = SimpleNamespace(sumo=SimpleNamespace(vehicle=vehicle)), 0.1

    def advance(self):
        return self.frames[-1]


ON = ("before", "in", "on", "last")


def eligible(traffic):
    return list(candidates_of(traffic, FREE, SENSOR, None).routes)


def test_a_car_may_be_the_ego_that_has_eight_seconds_of_way_at_its_speed():
    assert eligible(Standing(GRAPH, [20.0, 40.0], [ON, ON])) == [0, 1]
    assert eligible(Standing(GRAPH, [20.0], [ON], speed=22.0)) == [0]
    assert eligible(Standing(GRAPH, [20.0], [ON], speed=23.0)) == []


def test_one_that_comes_to_a_signal_soon_stands_is_unknown_or_on_no_edge_of_its_route_may_not():
    assert eligible(Standing(held_at(0), [20.0], [ON])) == []
    assert eligible(Standing(GRAPH, [20.0], [ON], speed=2.0)) == []
    assert eligible(Standing(GRAPH, [20.0], [ON], past=False)) == []
    assert eligible(Standing(GRAPH, [20.0], [("up",)])) == []
    assert eligible(Standing(GRAPH, [55.0], [ON], lane=2)) == []


def test_the_hand_over_tells_the_way_and_kinds_without_a_candidate_come_alone():
    traffic = Standing(GRAPH, [20.0], [ON])
    rng = np.random.default_rng(3)
    found = list(episode_starts(traffic, (FREE, BRAKE, CROSS), SENSOR, rng))
    assert [each if isinstance(each, str) else each.kind for each in found] == [FREE, BRAKE, CROSS]
    assert [GRAPH.name[lane] for lane in found[0].route.lanes] == ["in_0", ":j_0", "on_0", "last_0"]
    assert found[1:] == [BRAKE, CROSS]


@pytest.mark.parametrize(
    ("leader_m", "second_m", "found"), [(30.0, 75.0, "second"), (30.0, 85.0, ""), (50.0, 70.0, "")]
)
def test_who_is_to_brake_is_a_hidden_second_leader_seen_before_behind_a_near_leader(leader_m, second_m, found):
    # The second leader drives beside the lane of the others until the last moment.
    lanes = [[5.4, 5.4, 9.0]] * 20 + [[5.4, 5.4, 5.4]]
    lon, names = [500.0, 500.0 + leader_m, 500.0 + second_m], ["ego", "leader", "second"]
    frames = [frame_of(lon, lat, step=step, names=names) for step, lat in enumerate(lanes)]
    road = highway(3, 3.6)
    traffic = SimpleNamespace(frames=frames, network=SimpleNamespace(road=road))
    belief = believed_by_each(frames[-1], np.array([0]), road)
    assert hidden_second_leader(traffic, belief, 0, 0, SENSOR) == found
