import itertools
from dataclasses import replace

import numpy as np
import pytest

from harness.trackers.catalogue import build_tracker
from harness.trackers.kalman import LAT, LON, SPEED, GaussianStates
from harness.trackers.protocol import TrackerSetting
from harness.trackers.rivals.lives import Lives
from harness.trackers.rivals.pmbm.clusters import NO_TRACK, Cluster, Pruning, merged, simplified, together, united
from harness.trackers.rivals.pmbm.mixture import HypothesisMixture, Singles
from harness.trackers.rivals.pmbm.tracker import Pmbm, PmbmOptions
from mmpf.map.corridor_road import highway
from mmpf.scan import Detections, EgoPose, Scan, SensorModel
from mmpf.tracks import CONFIRMED, Tracks
from tests.harness.trackers.rivals import close_targets
from tests.harness.trackers.rivals.close_targets import (
    AT_FIRST,
    BIRTH,
    BORN,
    CLUTTER,
    NOISE,
    SEEN,
    SIDE_M,
    SURVIVES,
    followed,
    rms_gospa,
    scene,
)
from tests.mmpf.scenes import detections_at, ego_at

SETTING = TrackerSetting(highway(), SensorModel(), np.random.default_rng(0))
EVERYTHING = Pruning(gate_std=1e6, most=10**12, least_weight=1e-30, least_existence=1e-12)
PLACES = ((100.0, 100.0), (104.0, 99.0)), ((101.0, 100.5), (103.0, 99.5)), ((102.0, 100.0),)
SCANS = [np.array(places) for places in PLACES]


def posterior_of_all_histories() -> tuple[dict[frozenset, float], float]:
    """Enumerate every way in which the detections may have come about, each weighed without any filter.

    A vehicle's history is its detection, or none, at each scan from its birth to its death; which detections are one
    vehicle's is a partition of all of them. A part's weight sums over births, deaths and, if it is a single detection,
    clutter; given birth and the detections, all of these together are one Gaussian vector.

    Returns:
        Probability of each partition, and the expected number of vehicles detected so far that are alive at the end.
    """
    labels = [(scan, k) for scan, places in enumerate(SCANS) for k in range(len(places))]
    parts: dict[frozenset, tuple[float, float]] = {}
    for choice in itertools.product(*([None, *range(len(places))] for places in SCANS)):
        part = frozenset((scan, k) for scan, k in enumerate(choice) if k is not None)
        if part:
            parts[part] = part_weight(choice)
    weights: dict[frozenset, float] = {}
    alive: dict[frozenset, float] = {}
    for partition in partitions(labels):
        if all(part in parts for part in partition):
            weight = np.prod([parts[part][0] for part in partition])
            weights[frozenset(partition)] = float(weight)
            alive[frozenset(partition)] = float(weight) * sum(parts[part][1] for part in partition)
    total = sum(weights.values())
    return {key: weight / total for key, weight in weights.items()}, sum(alive.values()) / total


def part_weight(choice: tuple[int | None, ...]) -> tuple[float, float]:
    """Return the weight of a history, and the probability, given it, that its vehicle is alive at the end."""
    seen = [scan for scan, k in enumerate(choice) if k is not None]
    last = len(SCANS) - 1
    total = lives = 0.0
    for born in range(seen[0] + 1):
        rate = AT_FIRST if born == 0 else BORN
        density = density_of([SCANS[scan][choice[scan]] for scan in seen], [scan - born for scan in seen])
        for until in range(seen[-1], last + 1):
            chance = SURVIVES ** (until - born) * (1.0 if until == last else 1.0 - SURVIVES)
            missed = (1.0 - SEEN) ** (until - born + 1 - len(seen))
            weight = rate * chance * missed * SEEN ** len(seen) * density
            total += weight
            lives += weight if until == last else 0.0
    clutter = CLUTTER / SIDE_M**2 if len(seen) == 1 else 0.0
    return total + clutter, lives / (total + clutter)


def density_of(places: list[np.ndarray], ages: list[int]) -> float:
    """Return the density of the places of one vehicle, so many seconds old, as one Gaussian vector."""
    value = 1.0
    for axis in range(2):
        variance = BIRTH.covariance[0, 2 * axis, 2 * axis]
        speed = BIRTH.covariance[0, 2 * axis + 1, 2 * axis + 1]
        covariance = np.array(
            [
                [variance + speed * a * b + NOISE * (min(a, b) ** 2 * (3 * max(a, b) - min(a, b)) / 6) for b in ages]
                for a in ages
            ]
        ) + np.eye(len(ages))
        off = np.array([place[axis] for place in places]) - 100.0
        value *= np.exp(-0.5 * off @ np.linalg.solve(covariance, off)) / np.sqrt(np.linalg.det(2 * np.pi * covariance))
    return float(value)


def partitions(items: list) -> list[list[frozenset]]:
    if not items:
        return [[]]
    first, *rest = items
    found = []
    for smaller in partitions(rest):
        found.append([frozenset([first]), *smaller])
        found += [[*smaller[:k], part | {first}, *smaller[k + 1 :]] for k, part in enumerate(smaller)]
    return found


def partition_weights(mixture: HypothesisMixture) -> dict[frozenset, float]:
    """Return what the filter makes of the same partitions, from the detections that each hypothesis remembers."""
    order = [(scan, k) for scan, places in enumerate(SCANS) for k in range(len(places))]
    number = {1 + k: label for k, label in enumerate(order)}
    whole = merged(list(mixture.clusters), EVERYTHING)
    weights: dict[frozenset, float] = {}
    for row, log_weight in zip(whole.rows, whole.log_weight, strict=True):
        recent = [mixture.singles.recent[single] for single in row if single != NO_TRACK]
        key = frozenset(frozenset(number[each] for each in of if each != NO_TRACK) for of in recent)
        weights[key] = weights.get(key, 0.0) + float(np.exp(log_weight))
    return weights


def remembering(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let hypotheses remember their detections without uniting them."""
    nothing = close_targets.nothing
    monkeypatch.setattr(close_targets, "nothing", lambda _: nothing(count))


def test_every_association_has_the_weight_of_a_brute_force_enumeration(monkeypatch):
    remembering(len(SCANS), monkeypatch)
    mixture = followed(SCANS, EVERYTHING)[-1]
    known, alive = posterior_of_all_histories()
    found = partition_weights(mixture)
    assert sum(known.values()) == pytest.approx(1.0)
    for key, weight in known.items():
        assert found.get(key, 0.0) == pytest.approx(weight, rel=2e-3, abs=1e-9)
    whole = merged(list(mixture.clusters), EVERYTHING)
    expected = sum(
        np.exp(weight) * sum(mixture.singles.existence[single] for single in row if single != NO_TRACK)
        for row, weight in zip(whole.rows, whole.log_weight, strict=True)
    )
    assert expected == pytest.approx(alive, rel=1e-6)


def test_uniting_alike_hypotheses_keeps_the_weights_of_all():
    plain = followed(SCANS, EVERYTHING)[-1]
    short = followed(SCANS, replace(EVERYTHING, alike_scans=1))[-1]
    assert sum(len(cluster.rows) for cluster in short.clusters) < sum(len(cluster.rows) for cluster in plain.clusters)
    for cluster in short.clusters:
        assert np.exp(cluster.log_weight).sum() == pytest.approx(1.0)


def test_clusters_that_share_a_detection_are_grouped():
    assert together([[0], [1], [], [1, 2], [2], [3, 0]]) == [([0, 5], [0, 3]), ([1, 3, 4], [1, 2]), ([2], [])]


def test_what_is_sure_is_split_off_and_what_is_told_twice_is_summed():
    cluster = Cluster(((7, 1, NO_TRACK), (7, 2, 3), (7, 1, NO_TRACK)), tuple(np.log([0.5, 0.3, 0.2])))
    sure, rest = simplified(cluster)
    assert sure == Cluster(((7,),), (0.0,))
    assert rest.rows == ((1, NO_TRACK), (2, 3))
    assert np.exp(rest.log_weight) == pytest.approx([0.7, 0.3])
    assert united(rest, {1: "a", 2: "a", 3: None}).rows == ((1, NO_TRACK), (2, 3))
    assert united(rest, {1: "a", 2: "a", 3: "a"}).rows == ((1, NO_TRACK),)


def test_a_straight_target_without_clutter_is_a_kalman_filters():
    """One detection a scan and next to no clutter: the best hypothesis is the batch least-squares estimate."""
    rng = np.random.default_rng(4)
    ages = np.arange(8)
    places = np.column_stack([50.0 + 2.0 * ages, 200.0 - 1.0 * ages]) + rng.standard_normal((8, 2))
    mixture = followed([place[None] for place in places])[-1]
    best = mixture.best[mixture.singles.existence[mixture.best] > 0.5]
    prior = BIRTH.covariance[0, LON, LON]
    covariance = prior + np.outer(ages, ages) * BIRTH.covariance[0, SPEED, SPEED]
    low, high = np.minimum.outer(ages, ages), np.maximum.outer(ages, ages)
    covariance = covariance + NOISE * low**2 * (3 * high - low) / 6
    for row, axis in ((LON, 0), (LAT, 1)):
        known = 100.0 + covariance[-1] @ np.linalg.solve(covariance + np.eye(8), places[:, axis] - 100.0)
        # Where a target may also have been born later, newborns weigh in a little.
        assert mixture.singles.states.mean[best, row] == pytest.approx([known], abs=0.02)


@pytest.mark.slow
def test_four_targets_that_meet_among_clutter_are_followed_through():
    rng = np.random.default_rng(9)
    assert rms_gospa(scene(rng), 5, rng) == pytest.approx(2.84, abs=0.3)


def tracks_of_one_vehicle(options: dict[str, object], scans: int = 12) -> Tracks:
    tracker = build_tracker("pmbm", SETTING, options, tuned=False)
    for k in range(scans):
        found = detections_at([(220.0 + 2.0 * k, 5.5)], 0.2, 0.2)
        tracks = tracker.step(Scan(0.1 * k, found, ego_at(200.0 + 2.0 * k, 5.5)))
    return tracks


@pytest.mark.parametrize("share", [0.1, 1e-3, 1e-5])
def test_however_rare_newcomers_are_a_vehicle_that_is_seen_again_and_again_is_reported(share):
    tracks = tracks_of_one_vehicle({"newcomer_share": share})
    assert tracks.state.tolist() == [CONFIRMED]
    assert tracks.existence[0] > 0.9


def test_a_track_without_a_part_in_the_best_hypothesis_lies_in_the_shadow_of_every_other():
    """Two vehicles stand behind one another; whichever track is asked about, the front one hides the rear one."""
    tracker = Pmbm(PmbmOptions(), SETTING)
    lives = Lives(np.array([7, 9]), np.zeros(2), np.full(2, 5))
    mean = np.array([[210.0, 20.0, 5.5, 0.0], [230.0, 20.0, 5.5, 0.0]])
    states = GaussianStates(mean, np.tile(0.01 * np.eye(4), (2, 1, 1)))
    singles = Singles(lives, states, np.ones(2), np.tile([4.7, 1.9], (2, 1)), np.zeros((2, 0), dtype=np.int64))
    scan = Scan(0.0, Detections(*[np.zeros(0)] * 6), EgoPose(200.0, 5.5, 0.0, 20.0, 4.7, 1.9))
    both = HypothesisMixture(singles, (Cluster(((0,),), (0.0,)), Cluster(((1,),), (0.0,))))
    front_alone = HypothesisMixture(singles, (Cluster(((0,), (1,)), (-0.1, -2.4)),))
    for mixture in (both, front_alone):
        front, rear = tracker._seen(scan, mixture)
        assert front == pytest.approx(SETTING.sensor.detection_probability)
        assert rear == pytest.approx(PmbmOptions().hidden_probability)
