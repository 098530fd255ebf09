"""Small drives in which a filter that is too sure of false objects, or of vehicles, would endanger somebody."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest

from mmpf.joint.false_objects import FalseObjects
from mmpf.motion import motion_model
from mmpf.options.filter import FilterOptions
from mmpf.scan import SensorModel
from mmpf.tracker import MixtureTracker
from mmpf.tracks import TENTATIVE, Tracks
from tests.mmpf.scenes import ROAD, ego_at, lane_centre, scan_of

NEAR_M = 3.0
SENSOR = SensorModel(range_m=100.0)
USUAL = FilterOptions(particles=200)
EVERY_RATE = pytest.mark.parametrize("dt_s", [0.1, 0.2], ids=["10 Hz", "5 Hz"])
Place = tuple[float, float]


@dataclass(frozen=True)
class Source:
    """What gives detections.

    Attributes:
        place: Where it is at each time, metres on the road.
        detected: Share of scans in which it is detected.
        begins_s: When it appears.
        ends_s: When it is gone.
    """

    place: Callable[[float], Place]
    detected: float = 0.95
    begins_s: float = 0.0
    ends_s: float = np.inf

    def is_there(self, time_s: float) -> bool:
        return self.begins_s - 1e-9 <= time_s < self.ends_s - 1e-9


def steady(lon_m: float, lane: int, speed_mps: float, time_s: float) -> Place:
    return lon_m + speed_mps * time_s, lane_centre(lane)


def driving(lon_m: float, lane: int, speed_mps: float = 20.0, detected: float = 0.95) -> Source:
    return Source(partial(steady, lon_m, lane, speed_mps), detected)


def traffic(speed_mps: float = 20.0) -> list[Source]:
    """Cars that move as the ego does, in the lanes to the right and to the left of its own."""
    return [
        driving(lon_m, lane, speed_mps) for lane, lon_m in ((0, -40.0), (0, 25.0), (1, -15.0), (3, 55.0), (3, -30.0))
    ]


def drive(
    sources: list[Source],
    duration_s: float,
    dt_s: float = 0.1,
    speed_mps: float = 20.0,
    seed: int = 0,
    options: FilterOptions = USUAL,
) -> Iterator[tuple[float, Tracks, MixtureTracker]]:
    """Yield time, tracks and filter, scan by scan."""
    rng = np.random.default_rng(seed)
    filtering = MixtureTracker(ROAD, SENSOR, motion_model("cvm"), np.random.default_rng(seed), options)
    for time_s in np.arange(0.0, duration_s, dt_s):
        ego = ego_at(lon_m=speed_mps * time_s, speed_mps=speed_mps)
        seen = []
        for source in sources:
            lon, lat = source.place(time_s)
            is_seen = source.is_there(time_s) and rng.random() < source.detected
            place = lon + 0.25 * rng.standard_normal(), lat + 0.15 * rng.standard_normal()
            if is_seen and abs(lon - ego.lon_m) < SENSOR.range_m:
                seen.append(place)
        yield float(time_s), filtering.step(scan_of(float(time_s), seen, ego)), filtering


def is_reported(tracks: Tracks, place: Place) -> bool:
    near = np.hypot(tracks.lon_m - place[0], tracks.lat_m - place[1]) < NEAR_M
    return bool((near & (tracks.state != TENTATIVE)).any())


@pytest.mark.slow
@EVERY_RATE
def test_a_vehicle_that_is_detected_in_a_third_of_scans_keeps_a_reported_track(dt_s: float) -> None:
    dark, reported = driving(20.0, 3, detected=0.35), []
    for seed in range(3):
        for time_s, tracks, _ in drive([dark, *traffic()], 12.0, dt_s, seed=seed):
            if time_s >= 1.0:
                reported.append(is_reported(tracks, dark.place(time_s)))
    assert np.mean(reported) >= 0.85


@pytest.mark.slow
@pytest.mark.parametrize(("dt_s", "flow_mps", "seed"), [(0.1, 10.0, 0), (0.1, 25.0, 1), (0.2, 10.0, 1), (0.2, 25.0, 0)])
def test_a_car_that_stands_amid_flowing_traffic_is_reported_from_eighty_metres_on(
    dt_s: float, flow_mps: float, seed: int
) -> None:
    standing = driving(150.0, 2, 0.0, detected=0.97)
    reported = []
    for time_s, tracks, _ in drive([standing, *traffic(flow_mps)], 145.0 / flow_mps, dt_s, flow_mps, seed):
        if 150.0 - flow_mps * time_s < 80.0:
            reported.append(is_reported(tracks, standing.place(time_s)))
    assert np.mean(reported) >= 0.85


@pytest.mark.slow
def test_a_car_that_stands_is_reported_where_it_is_and_not_creeping_ahead() -> None:
    standing, ahead_m, speed_mps = driving(150.0, 2, 0.0), [], []
    for seed in range(3):
        for time_s, tracks, _ in drive([standing, *traffic(10.0)], 14.5, speed_mps=10.0, seed=seed):
            if time_s >= 10.0:
                its = np.hypot(tracks.lon_m - 150.0, tracks.lat_m - lane_centre(2)) < NEAR_M
                ahead_m.extend(tracks.lon_m[its] - 150.0)
                speed_mps.extend(tracks.speed_mps[its])
    assert abs(np.mean(ahead_m)) < 0.1
    assert np.mean(speed_mps) < 0.15


@EVERY_RATE
@pytest.mark.parametrize("begins_s", [0.0, 2.0, 5.0])
def test_what_flashes_once_is_never_reported(dt_s: float, begins_s: float) -> None:
    flash = Source(partial(steady, 30.0, 4, 20.0), 1.0, begins_s, begins_s + dt_s)
    assert not any(
        is_reported(tracks, flash.place(time_s)) for time_s, tracks, _ in drive([flash, *traffic()], 8.0, dt_s)
    )


def false_objects(duration_s: float, life_s: float, seed: int) -> list[Source]:
    """One after the other, in plain view and out of the ego's path; every third moves along with the traffic."""
    rng = np.random.default_rng(seed)
    found = []
    for number, begins_s in enumerate(np.arange(1.0, duration_s, life_s)):
        speed_mps = 20.0 if number % 3 == 0 else 0.0
        lane = int(rng.choice([0, 4]))
        ahead_m = rng.uniform(15.0, 40.0) if speed_mps else rng.uniform(48.0, 58.0)
        begin_m = ahead_m + (20.0 - speed_mps) * begins_s
        found.append(Source(partial(steady, begin_m, lane, speed_mps), 0.7, float(begins_s), float(begins_s + life_s)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dt_s", "seed", "beside_m", "most"),
    [(0.1, 0, 0.0, 1.0 / 3.0), (0.2, 1, 0.0, 1.0 / 3.0), (0.1, 0, USUAL.joint.path.beside_m, 0.5)],
)
def test_false_objects_are_soon_not_reported_any_more_and_vehicles_always_are(
    dt_s: float, seed: int, beside_m: float, most: float
) -> None:
    """Half a false object a second that lives for two; a car comes into range only after all these were found.

    They lie beside the ego's path, where improbable vehicles are reported too: so more of them are, if that counts.
    """
    path = USUAL.joint.path.model_copy(update={"beside_m": beside_m})
    options = USUAL.model_copy(update={"joint": USUAL.joint.model_copy(update={"path": path})})
    false, overtaking = false_objects(45.0, 2.0, seed), driving(-300.0, 1, 28.0)
    reported, vehicles, learned = [], [], FalseObjects.none()
    for time_s, tracks, filtering in drive([*false, overtaking, *traffic()], 45.0, dt_s, 20.0, seed, options):
        learned = filtering.rule.known.false_objects
        if time_s >= 20.0:
            reported += [is_reported(tracks, each.place(time_s)) for each in false if each.is_there(time_s)]
            there = [*traffic(), *([overtaking] if time_s >= 28.0 else [])]
            vehicles += [is_reported(tracks, each.place(time_s)) for each in there]
    assert np.mean(reported) < most
    assert np.mean(vehicles) > 0.95
    prior = options.joint.false_objects
    assert 0.25 < learned.births_per_s(SENSOR, prior) < 0.75
    assert learned.mean_life_s(prior) == pytest.approx([2.0, 2.0], rel=0.3)
    assert learned.kind_shares(prior)[0] == pytest.approx(2.0 / 3.0, abs=0.15)


@EVERY_RATE
def test_a_false_object_that_ends_in_plain_view_is_counted_once(dt_s: float) -> None:
    false = Source(partial(steady, 100.0, 4, 0.0), 0.6, 3.0, 5.0)
    counted = {}
    for time_s, _, filtering in drive([false, *traffic()], 12.0, dt_s):
        counted[round(time_s, 3)] = float(filtering.rule.known.false_objects.counted.sum())
    assert counted[3.0] < 0.05
    assert 0.6 < max(counted.values()) <= 1.0
    assert counted[10.0] == pytest.approx(max(counted.values()), rel=0.1)
    assert all(counted[later] <= counted[7.0] for later in counted if later > 7.0)


@pytest.mark.slow
def test_without_false_objects_what_appears_in_plain_view_is_soon_a_vehicle() -> None:
    newcomer = Source(partial(steady, 30.0, 4, 20.0), 0.95, 40.0)
    scans = drive([newcomer, *traffic()], 43.0)
    reported = [is_reported(tracks, newcomer.place(time_s)) for time_s, tracks, _ in scans if time_s >= 41.5]
    assert np.mean(reported) > 0.95


def test_the_papers_rule_knows_no_kinds() -> None:
    """Whatever appears, stands and ends is to it what any vehicle is."""
    false = false_objects(6.0, 2.0, 0)
    papers = FilterOptions(update="max_likelihood", particles=200)
    for _, _, filtering in drive([*false, *traffic()], 6.0, options=papers):
        components = filtering.mixture.components
        assert (components.vehicle == components.existence).all()
        assert not hasattr(components, "kinds")
