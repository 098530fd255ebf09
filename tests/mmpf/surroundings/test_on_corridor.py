"""The compiled surroundings against a plain reading of their definition, one particle at a time."""

from dataclasses import fields, replace

import numpy as np
import pytest

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments, component_moments
from mmpf.belief.resampling import resample
from mmpf.joint.kinds import SHAPE, STANDING, VEHICLE
from mmpf.map.corridor_road import CorridorRoad, highway
from mmpf.map.road import Lane, Road
from mmpf.motion.protocol import Neighbour, Surroundings
from mmpf.motion.state import ACCEL, LAT, LON, SPEED
from mmpf.numerics.arrays import BoolArray
from mmpf.scan import EgoPose
from mmpf.surroundings.on_corridor import surroundings_of
from tests.mmpf.scenes import belief_of, spot

RAMPED = CorridorRoad(
    lanes=(*highway(3).lanes, Lane(number=6, right_m=-3.66, left_m=0.0, start_m=40.0, end_m=90.0)),
    section_m=(0.0, 640.0),
)
NEIGHBOURS = {
    "leader": (0, True), "left_leader": (1, True), "left_follower": (1, False), "right_leader": (-1, True),
    "right_follower": (-1, False),
}  # fmt: skip


def with_even_doubts(belief: Mixture) -> Mixture:
    """Return a belief whose particles have doubts that are spread evenly from 0 to 1, in tens."""
    doubt = (np.arange(len(belief.cloud)) % 10 + 0.5) / 10.0
    return replace(belief, cloud=replace(belief.cloud, latents=doubt[None]))


class Scene:
    """Components of a few particles each, scattered over road and verge."""

    def __init__(self, road: Road, components: int, particles: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.road = road
        self.component = np.repeat(np.arange(components), particles)
        centre = np.stack([rng.uniform(0.0, 120.0, components), rng.uniform(-5.0, 14.0, components)])
        self.state = rng.normal(0.0, 1.0, (6, len(self.component)))
        self.state[[LON, LAT]] += centre[:, self.component]
        self.state[SPEED] = rng.uniform(0.0, 30.0, len(self.component))
        self.mean = np.stack([
            [row[self.component == m].mean() for m in range(components)] for row in self.state
        ]).reshape(6, components)  # fmt: skip
        self.length = rng.uniform(3.5, 18.0, components)
        self.width = rng.uniform(1.6, 2.6, components)
        self.is_neighbour = rng.random(components) < 0.8
        self.is_seen = rng.random(components) < 0.7
        self.ego = EgoPose(60.0, 5.5, 0.0, 20.0, 5.2, 1.8)
        self.ego_accel = -0.7

    def surroundings(self) -> Surroundings:
        states = [self.state[:, self.component == m] for m in range(self.mean.shape[1])]
        belief = belief_of(states, length_m=self.length, width_m=self.width, confirmed=self.is_neighbour)
        moments = Moments(self.mean, np.zeros_like(self.mean), self.mean[0] * 0.0)
        args = moments, self.is_seen, self.ego, self.ego_accel, self.road
        return surroundings_of(with_even_doubts(belief), *args)

    def others(self) -> list[dict[str, float]]:
        """Return everyone that counts as a vehicle, the ego last."""
        vehicles = [
            {
                "index": m, "lon": self.mean[LON, m], "lat": self.mean[LAT, m], "speed": self.mean[SPEED, m],
                "accel": self.mean[ACCEL, m], "length": self.length[m], "width": self.width[m],
            }
            for m in range(self.mean.shape[1])
            if self.is_neighbour[m]
        ]  # fmt: skip
        ego = self.ego
        return [*vehicles, {
            "index": self.mean.shape[1], "lon": ego.lon_m, "lat": ego.lat_m, "speed": ego.speed_mps,
            "accel": self.ego_accel, "length": ego.length_m, "width": ego.width_m,
        }]  # fmt: skip


def lane_of(road: Road, lon: float, lat: float) -> Lane | None:
    for lane in road.lanes:
        if lane.start_m <= lon < lane.end_m and lane.right_m <= lat < lane.left_m:
            return lane
    return None


def nearest_lane_of(road: Road, lon: float, lat: float) -> Lane | None:
    """Return the lane that a place is in or at most a metre outside of, none on a ramp."""

    def away(lane: Lane) -> float:
        if not lane.start_m <= lon < lane.end_m:
            return np.inf
        return abs(lat - 0.5 * (lane.right_m + lane.left_m)) - 0.5 * (lane.left_m - lane.right_m)

    nearest = min(road.lanes, key=away)
    return nearest if away(nearest) < 1.0 else None


def beside(road: Road, lane: Lane | None, direction: int) -> Lane | None:
    """Return the lane whose line touches this one's to the left (1) or right (-1), wherever along the road it lies."""
    if direction == 0 or lane is None:
        return lane
    for other in road.lanes:
        apart = other.right_m - lane.left_m if direction > 0 else lane.right_m - other.left_m
        if abs(apart) < 0.5:
            return other
    return None


def expected_neighbour(scene: Scene, n: int, lane: Lane | None, ahead: bool) -> dict[str, float] | None:
    """Return who is nearest: in the own lane among those in the way, in another among its vehicles not in the way.

    In the way is who would be touched, or nearly, when driving straight on: bodies that overlap sideways by more than
    15 % of their mean width.
    """
    own = scene.component[n]
    own_lane = lane_of(scene.road, scene.mean[LON, own], scene.mean[LAT, own])

    def belongs(other: dict[str, float]) -> bool:
        strip = lane_of(scene.road, other["lon"], other["lat"])
        if own_lane is None or strip is None:
            return strip is not None and strip == lane
        mean_width = 0.5 * (scene.width[own] + other["width"])
        overlap = mean_width - abs(other["lat"] - scene.mean[LAT, own])
        if lane == own_lane:
            return overlap > 0.15 * mean_width
        return strip == lane and overlap <= 0.15 * mean_width

    candidates = [
        other
        for other in scene.others()
        if lane is not None
        and other["index"] != own
        and belongs(other)
        and (other["lon"] > scene.mean[LON, own]) == ahead
    ]
    return min(candidates, key=lambda other: abs(other["lon"] - scene.mean[LON, own]), default=None)


@pytest.mark.parametrize("road", [highway(5), RAMPED], ids=["highway", "with a ramp"])
@pytest.mark.parametrize("seed", range(4))
def test_every_particle_knows_its_lane_and_its_neighbours(road, seed):
    scene = Scene(road, components=14, particles=6, seed=seed)
    found = scene.surroundings()
    for n in range(len(scene.component)):
        lon, lat, speed = scene.state[[LON, LAT, SPEED], n]
        lane = nearest_lane_of(road, lon, lat)
        length = scene.length[scene.component[n]]
        assert found.length_m[n] == length
        if lane is None:
            assert np.isnan([found.lane_right_m[n], found.lane_left_m[n]]).all()
        else:
            assert (found.lane_right_m[n], found.lane_left_m[n]) == (lane.right_m, lane.left_m)
        for direction, there in ((1, found.has_left_lane[n]), (-1, found.has_right_lane[n])):
            strip = beside(road, lane, direction)
            assert there == (strip is not None and strip.start_m <= lon < strip.end_m)
        for name, (direction, ahead) in NEIGHBOURS.items():
            strip = beside(road, lane, direction)
            if direction and strip is not None and not strip.start_m <= lon < strip.end_m:
                strip = None
            expected = expected_neighbour(scene, n, strip, ahead)
            one: Neighbour = getattr(found, name)
            assert one.exists[n] == (expected is not None)
            if expected is None:
                assert (one.gap_m[n], one.speed_mps[n], one.accel_mps2[n]) == (np.inf, speed, 0.0)
                assert one.length_m[n] == length
                continue
            distance = expected["lon"] - lon if ahead else lon - expected["lon"]
            gap = distance - 0.5 * (length + expected["length"])
            assert one.gap_m[n] == pytest.approx(gap, abs=1e-12)
            assert one.speed_mps[n] == expected["speed"]
            assert one.accel_mps2[n] == expected["accel"]
            assert one.length_m[n] == expected["length"]


def test_particles_of_components_that_were_not_seen_lately_are_hidden():
    scene = Scene(highway(5), components=12, particles=3, seed=0)
    assert scene.surroundings().is_hidden.tolist() == [not scene.is_seen[own] for own in scene.component]


def test_without_components_there_is_nothing_to_know():
    scene = Scene(highway(5), components=0, particles=3, seed=0)
    found = scene.surroundings()
    for column in fields(found):
        value = getattr(found, column.name)
        assert len(value if isinstance(value, np.ndarray) else value.gap_m) == 0


def test_a_car_on_the_line_that_leaves_room_is_nobodys_leader():
    # Both in the middle lane, 20 m behind each other and 1.7 m apart: bodies of 1.9 m overlap by 0.2 m, less than 15 %.
    mean = np.zeros((6, 2))
    mean[LON], mean[LAT], mean[SPEED] = [50.0, 70.0], [3.8, 5.5], [20.0, 15.0]
    far_ego = EgoPose(-500.0, 5.5, 0.0, 20.0, 4.7, 1.9)
    belief = belief_of([mean[:, :1], mean[:, 1:]], length_m=[4.7, 4.7], width_m=[1.9, 1.9], confirmed=[True, True])
    moments, is_seen = Moments(mean, np.zeros_like(mean), np.zeros(2)), np.full(2, True)
    found = surroundings_of(with_even_doubts(belief), moments, is_seen, far_ego, 0.0, highway(3))
    assert not found.leader.exists[0]
    assert not found.left_leader.exists[0]
    assert not found.right_leader.exists[0]


def behind_a_doubtful_one(probability: float, weight: list[float] | None = None) -> Mixture:
    """Return a belief of ten particles, weighted evenly or as given, behind what is probably a vehicle or is not."""
    kinds = np.zeros((2, *SHAPE))
    kinds[:, VEHICLE, 0, -1] = [1.0, probability]
    kinds[:, STANDING, 0, -1] = [0.0, 1.0 - probability]
    spots, even = [spot(0.0, 5.5), spot(30.0, 5.5, 0.0)], np.full(10, 0.1)
    weights = [even if weight is None else np.array(weight), even]
    return with_even_doubts(belief_of(spots, weights, confirmed=[True, True], kinds=kinds))


def heeding(belief: Mixture) -> BoolArray:
    """Return which particles of the first vehicle have the second for a leader."""
    ego, seen = EgoPose(-200.0, 5.5, 0.0, 20.0, 4.7, 1.9), np.ones(2, dtype=bool)
    found = surroundings_of(belief, component_moments(belief), seen, ego, 0.0, highway(5))
    return found.leader.exists[: belief.starts[1]]


@pytest.mark.parametrize(("probability", "share"), [(1.0, 1.0), (0.4, 0.4), (0.02, 0.0)])
def test_as_many_particles_heed_a_leader_as_it_is_probably_a_vehicle(probability, share):
    assert heeding(behind_a_doubtful_one(probability)).mean() == pytest.approx(share)


def test_the_descendants_of_particles_that_do_not_heed_a_leader_do_not_heed_it_either():
    heeds = heeding(behind_a_doubtful_one(0.4))
    belief = behind_a_doubtful_one(0.4, list(np.where(heeds, 1e-9, (1.0 - 1e-9 * heeds.sum()) / (~heeds).sum())))
    after, _ = resample(belief, np.array([True, False]), 50, np.random.default_rng(0))
    assert len(heeding(after)) == 50
    assert not heeding(after).any()
