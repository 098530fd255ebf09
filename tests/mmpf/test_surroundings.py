"""The compiled surroundings against a plain reading of their definition, one particle at a time."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from mmpf.motion.protocol import Neighbour, Surroundings
from mmpf.options import Footprint
from mmpf.road import Lane, Road, highway
from mmpf.scan import EgoPose
from mmpf.state import ACCEL, LAT, LON, SPEED
from mmpf.surroundings import surroundings_of

VEHICLE = Footprint()
RAMPED = Road(
    lanes=(*highway(3).lanes, Lane(number=6, right_m=-3.66, left_m=0.0, start_m=40.0, end_m=90.0)),
    section_m=(0.0, 640.0),
)
NEIGHBOURS = {
    "leader": (0, True), "left_leader": (1, True), "left_follower": (1, False), "right_leader": (-1, True),
    "right_follower": (-1, False),
}  # fmt: skip


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
        self.is_neighbour = rng.random(components) < 0.8
        self.is_seen = rng.random(components) < 0.7
        self.ego = EgoPose(60.0, 5.5, 0.0, 20.0, 5.2, 1.8)
        self.ego_accel = -0.7

    def surroundings(self) -> Surroundings:
        return surroundings_of(
            self.state, self.component, self.mean, self.is_neighbour, self.is_seen, self.ego, self.ego_accel,
            self.road, VEHICLE,
        )  # fmt: skip

    def others(self) -> list[dict[str, float]]:
        """Return everyone that counts as a vehicle, the ego last."""
        vehicles = [
            {
                "index": m, "lon": self.mean[LON, m], "lat": self.mean[LAT, m], "speed": self.mean[SPEED, m],
                "accel": self.mean[ACCEL, m], "length": VEHICLE.length_m,
            }
            for m in range(self.mean.shape[1])
            if self.is_neighbour[m]
        ]  # fmt: skip
        ego = self.ego
        return [*vehicles, {
            "index": self.mean.shape[1], "lon": ego.lon_m, "lat": ego.lat_m, "speed": ego.speed_mps,
            "accel": self.ego_accel, "length": ego.length_m,
        }]  # fmt: skip


def lane_of(road: Road, lon: float, lat: float) -> Lane | None:
    for lane in road.lanes:
        if lane.start_m <= lon < lane.end_m and lane.right_m <= lat < lane.left_m:
            return lane
    return None


def nearest_lane_of(road: Road, lon: float, lat: float) -> Lane:
    def away(lane: Lane) -> float:
        if not lane.start_m <= lon < lane.end_m:
            return np.inf
        return abs(lat - 0.5 * (lane.right_m + lane.left_m)) - 0.5 * (lane.left_m - lane.right_m)

    return min(road.lanes, key=away)


def beside(road: Road, lane: Lane, direction: int) -> Lane | None:
    """Return the lane whose line touches this one's to the left (1) or right (-1), wherever along the road it lies."""
    if direction == 0:
        return lane
    for other in road.lanes:
        apart = other.right_m - lane.left_m if direction > 0 else lane.right_m - other.left_m
        if abs(apart) < 0.5:
            return other
    return None


def expected_neighbour(scene: Scene, n: int, lane: Lane | None, ahead: bool) -> dict[str, float] | None:
    own = scene.component[n]
    candidates = [
        other
        for other in scene.others()
        if other["index"] != own
        and lane is not None
        and lane_of(scene.road, other["lon"], other["lat"]) == lane
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
                assert one.length_m[n] == VEHICLE.length_m
                continue
            distance = expected["lon"] - lon if ahead else lon - expected["lon"]
            gap = distance - 0.5 * (VEHICLE.length_m + expected["length"])
            assert one.gap_m[n] == pytest.approx(gap, abs=1e-12)
            assert one.speed_mps[n] == expected["speed"]
            assert one.accel_mps2[n] == expected["accel"]
            assert one.length_m[n] == expected["length"]


@pytest.mark.parametrize("seed", range(3))
def test_the_flow_is_the_mean_speed_of_seen_traffic_weighted_by_nearness_and_lane(seed):
    scene = Scene(highway(5), components=12, particles=3, seed=seed)
    found = scene.surroundings()
    for n, own in enumerate(scene.component):
        weights, speeds = [], []
        lane = lane_of(scene.road, scene.mean[LON, own], scene.mean[LAT, own])
        for m in range(12):
            if m == own or not (scene.is_neighbour[m] and scene.is_seen[m]):
                continue
            same = lane_of(scene.road, scene.mean[LON, m], scene.mean[LAT, m]) == lane
            weights.append(np.exp(-abs(scene.mean[LON, m] - scene.mean[LON, own]) / 25.0) * (1.0 if same else 0.15))
            speeds.append(scene.mean[SPEED, m])
        assert found.flow_speed_mps[n] == pytest.approx(np.average(speeds, weights=weights), rel=1e-12)
        assert found.is_hidden[n] == (not scene.is_seen[own])


def test_without_components_there_is_nothing_to_know():
    scene = Scene(highway(5), components=0, particles=3, seed=0)
    found = scene.surroundings()
    for column in fields(found):
        value = getattr(found, column.name)
        assert len(value if isinstance(value, np.ndarray) else value.gap_m) == 0
