"""A vehicle that appears in plain view amid flowing traffic is reported within seconds at any detection rate."""

import numpy as np
import pytest

from mmpf import MixtureTracker, Scan, SensorModel, highway, motion_model
from mmpf.tracks import TENTATIVE
from tests.mmpf.scenes import detections_at, ego_at

FLOW_MPS, APPEARS_S = 20.0, 8.0
FALSE_OBJECTS, FALSE_LIFE_S = 4, 2.0


def false_places(time_s: float, rng: np.random.Generator) -> list[tuple[float, int]]:
    """Four false objects at a time that move with the traffic: what appears in plain view is first taken for one."""
    begun_s = time_s - 0.5 - FALSE_LIFE_S / FALSE_OBJECTS * np.arange(FALSE_OBJECTS)
    found = []
    for number, life in enumerate(np.floor(begun_s / FALSE_LIFE_S).astype(int)):
        place = np.random.default_rng([number, life + 1])
        if begun_s[number] >= 0.0 and rng.random() < 0.6:
            found.append((float(place.uniform(12.0, 55.0) * place.choice([-1, 1])), 3))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("probability", "within_s", "seed"), [(0.97, 2.0, 0), (0.6, 3.0, 1), (0.35, 5.0, 2), (0.35, 5.0, 0)]
)
def test_a_vehicle_that_appears_in_plain_view_is_reported(probability: float, within_s: float, seed: int) -> None:
    rng, road = np.random.default_rng(seed), highway(lanes=5)
    lateral = [lane.centre_m for lane in road.lanes]
    sensor = SensorModel(range_m=100.0, clutter_per_scan=5.0)
    tracker = MixtureTracker(road, sensor, motion_model("cvm"), np.random.default_rng(seed))
    others = [(60.0 * side, lateral[k]) for k in (0, 4) for side in (-1, 0, 1)]
    reported_s = None
    for step in range(int(10 * (APPEARS_S + within_s)) + 1):
        time_s = 0.1 * step
        ego_m = FLOW_MPS * time_s
        places = [(ego_m + ahead, lat) for ahead, lat in others]
        places += [(ego_m + ahead, lateral[lane]) for ahead, lane in false_places(time_s, rng)]
        newcomer = (ego_m + 25.0, lateral[1])
        if time_s >= APPEARS_S and rng.random() < probability:
            places.append(newcomer)
        noisy = np.array(places) + [0.25, 0.15] * rng.standard_normal((len(places), 2))
        scan = Scan(time_s, detections_at(noisy.tolist(), 0.3, 0.18), ego_at(ego_m, lateral[2], FLOW_MPS))
        tracks = tracker.step(scan)
        near = np.hypot(tracks.lon_m - newcomer[0], tracks.lat_m - newcomer[1]) < 3.0
        if reported_s is None and time_s >= APPEARS_S and (near & (tracks.state != TENTATIVE)).any():
            reported_s = time_s - APPEARS_S
    assert reported_s <= within_s
