"""A conformance suite for trackers, including the user's own.

    from harness.plugins import check_tracker, tracker_checks

    check_tracker(make_tracker)                     # all of them; raises with every finding

    @pytest.mark.parametrize("check", tracker_checks(), ids=str)
    def test_my_tracker(check):                     # or one test for each
        check(make_tracker)

``make_tracker`` is what ``tracker=package.module:make_tracker`` takes: a function of the setting and the options.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from harness.trackers.conformance.plane_scenes import bend_scene, crossing_scene, scans_in_plane
from harness.trackers.conformance.requirements import (
    Build,
    HasPlace,
    TrackerCheckError,
    follow,
    nearest_position,
    nearest_track,
    require,
    require_refusal,
    step,
)
from harness.trackers.conformance.scripted_scenes import (
    EGO_START_M,
    ROAD,
    SENSOR,
    STEP_S,
    LabelledScan,
    ScriptedCar,
    busy_scene,
    ego_at,
    impossible_versions,
    labelled_scan,
    scripted_scans,
    separate_cars,
    shuffled,
    times_every_step,
    without_sizes,
)
from harness.trackers.protocol import AnyTracker, TrackerFactory, TrackerSetting
from mmpf.map.road import Road
from mmpf.scan import Detections
from mmpf.tracks import CONFIRMED, TENTATIVE, Tracks

_LANE_CENTRES_M = tuple(lane.centre_m for lane in ROAD.lanes)


@dataclass(frozen=True)
class TrackerCheck:
    """One check of the suite.

    Attributes:
        examine: The check itself, given a function that builds the tracker from a seed.
    """

    name: str
    examine: Callable[[Build], None]
    road: Road = ROAD

    def __call__(self, make_tracker: TrackerFactory, options: Mapping[str, object] | None = None) -> None:
        """Examine a tracker.

        Raises:
            TrackerCheckError: The check failed.
        """

        def build(seed: int) -> AnyTracker:
            setting = TrackerSetting(road=self.road, sensor=SENSOR, rng=np.random.default_rng(seed), step_s=STEP_S)
            return make_tracker(setting, dict(options or {}))

        self.examine(build)

    def __str__(self) -> str:
        return self.name


def check_tracker(make_tracker: TrackerFactory, options: Mapping[str, object] | None = None) -> None:
    """Run all checks against a tracker.

    Args:
        make_tracker: Builds the tracker from its setting and options.
        options: The options to build it with.

    Raises:
        TrackerCheckError: At least one check failed; the message has a line for each.
    """
    findings = []
    for check in tracker_checks():
        try:
            check(make_tracker, options)
        except TrackerCheckError as finding:
            findings.append(f"{check.name}: {finding}")
    if findings:
        raise TrackerCheckError("\n".join(findings))


def tracker_checks() -> list[TrackerCheck]:
    """Return all checks, for parametrised tests: the functions of this module that are named so, in their order."""
    found = [value for name, value in globals().items() if name.startswith("_check_")]
    roads = {_check_identities_stay_on_a_bend: bend_scene, _check_identities_stay_at_a_crossing: crossing_scene}
    return [
        TrackerCheck(check.__name__.removeprefix("_check_"), check, roads[check]()[0] if check in roads else ROAD)
        for check in found
    ]


def _check_tracks_are_well_formed(build: Build) -> None:
    follow(build, busy_scene())


def _check_one_car_becomes_one_confirmed_track(build: Build) -> None:
    car = ScriptedCar("car", EGO_START_M + 30.0, speed_mps=24.0)
    scans = scripted_scans([car], times_every_step(3.0), np.random.default_rng(1))
    ids = set()
    for labelled, tracks in zip(scans, follow(build, scans), strict=True):
        if labelled.scan.time_s < 1.0:
            continue
        confirmed = np.flatnonzero(tracks.state != TENTATIVE)
        require(len(confirmed) == 1, f"{len(confirmed)} confirmed tracks of one car", labelled)
        time_s, track = labelled.scan.time_s, confirmed[0]
        error_m = float(np.hypot(tracks.lon_m[track] - car.lon_at(time_s), tracks.lat_m[track] - car.lat_m))
        require(error_m < 1.0, f"the track is {error_m:.2f} m from its car", labelled)
        ids.add(int(tracks.track_id[track]))
    require(len(ids) == 1, f"one car had the identities {sorted(ids)}")


def _check_identities_stay_with_their_cars(build: Build) -> None:
    cars = separate_cars()
    scans = scripted_scans(cars, times_every_step(5.0), np.random.default_rng(2), detection_probability=0.95)
    _require_identities(build, cars, scans)


def _require_identities(build: Build, cars: Sequence[HasPlace], scans: Sequence[LabelledScan]) -> None:
    held: dict[str, set[int]] = {car.name: set() for car in cars}
    first: dict[str, float] = {}
    for labelled, tracks in zip(scans, follow(build, scans), strict=True):
        if labelled.scan.time_s >= 1.5:
            for car in cars:
                held[car.name].add(int(tracks.track_id[nearest_track(tracks, car, labelled)]))
                if len(held[car.name]) > 1:
                    first.setdefault(car.name, labelled.scan.time_s)
    changed = [f"{name} at {time_s:.1f} s, tracks {sorted(held[name])}" for name, time_s in first.items()]
    require(not changed, f"cars far apart changed identity: {'; '.join(changed)}")


def _check_identities_are_never_used_again(build: Build) -> None:
    first = ScriptedCar("first", EGO_START_M + 60.0, lane=1, until_s=3.0)
    second = ScriptedCar("second", EGO_START_M - 60.0, lane=5, from_s=43.0)
    times_s = [
        *times_every_step(3.0),
        *np.arange(4.0, 43.0).tolist(),
        *(43.0 + np.array(times_every_step(3.0))).tolist(),
    ]
    scans = scripted_scans([first, second], times_s, np.random.default_rng(3))
    ids: dict[str, set[int]] = {"first": set(), "second": set()}
    for labelled, tracks in zip(scans, follow(build, scans), strict=True):
        name = "first" if labelled.scan.time_s < 4.0 else "second" if labelled.scan.time_s >= 43.0 else None
        if name:
            ids[name] |= set(tracks.track_id[tracks.state == CONFIRMED].tolist())
    both = ids["first"] & ids["second"]
    require(not both, f"identities {sorted(both)} were used again 40 s later for another car 120 m away")


def _check_equal_seeds_give_equal_tracks(build: Build) -> None:
    scans = busy_scene()
    first = follow(build, scans)
    # A tracker that draws from the global generator must be found out.
    np.random.random()  # noqa: NPY002
    second = follow(build, scans)
    for labelled, one, other in zip(scans, first, second, strict=True):
        for column in fields(Tracks):
            same = getattr(one, column.name).tobytes() == getattr(other, column.name).tobytes()
            require(same, f"two runs with equal seeds differ in {column.name}", labelled)


def _check_order_of_detections_means_nothing(build: Build) -> None:
    cars = separate_cars()
    scans = scripted_scans(cars, times_every_step(3.0), np.random.default_rng(4))
    mixed = [shuffled(labelled, np.arange(len(labelled.truth_id))[::-1]) for labelled in scans]
    pairs = zip(scans, follow(build, scans), follow(build, mixed), strict=True)
    for labelled, tracks, others in pairs:
        if labelled.scan.time_s < 1.0:
            continue
        counts = int((tracks.state == CONFIRMED).sum()), int((others.state == CONFIRMED).sum())
        require(counts[0] == counts[1], f"{counts[0]} confirmed tracks, {counts[1]} in reversed order", labelled)
        for car in cars:
            one, other = nearest_position(tracks, car, labelled), nearest_position(others, car, labelled)
            distance_m = float(np.hypot(*(one - other)))
            require(distance_m < 0.5, f"reversing the detections moves a track by {distance_m:.2f} m", labelled)


def _check_scans_are_left_as_they_were(build: Build) -> None:
    tracker = build(0)
    for labelled in busy_scene()[:20]:
        before = _content(labelled.scan.detections)
        step(tracker, labelled)
        after = _content(labelled.scan.detections)
        for name, content in before.items():
            require(after[name] == content, f"the tracker wrote to detections.{name}", labelled)


def _check_sizes_need_not_be_measured(build: Build) -> None:
    scans = [
        without_sizes(labelled)
        for labelled in scripted_scans(separate_cars(), times_every_step(3.0), np.random.default_rng(12))
    ]
    last = follow(build, scans)[-1]
    for car in separate_cars():
        nearest_track(last, car, scans[-1])


def _check_no_detections_for_5_s(build: Build) -> None:
    follow(build, [labelled_scan(time_s, [], [], []) for time_s in times_every_step(5.0)])
    cars = [replace(car, until_s=2.0) for car in separate_cars()]
    cars += [replace(car, name=f"{car.name} again", from_s=7.0) for car in separate_cars()]
    follow(build, scripted_scans(cars, times_every_step(8.0), np.random.default_rng(5)))


def _check_nothing_but_clutter(build: Build) -> None:
    follow(build, scripted_scans([], times_every_step(5.0), np.random.default_rng(6), clutter_per_scan=8.0))


def _check_two_detections_at_one_point(build: Build) -> None:
    scans = []
    for time_s in times_every_step(2.0):
        lon_m = ego_at(time_s).lon_m + 25.0
        scans.append(labelled_scan(time_s, [lon_m, lon_m], [_LANE_CENTRES_M[1]] * 2, ["car", "car"]))
    follow(build, scans)


def _check_500_detections(build: Build) -> None:
    rng = np.random.default_rng(7)
    scans = scripted_scans(separate_cars(), times_every_step(1.0), rng)
    crowd = scans[-1].scan
    lon_m = crowd.ego.lon_m + rng.uniform(-SENSOR.range_m, SENSOR.range_m, 500)
    lat_m = rng.uniform(0.0, 5 * 3.66, 500)
    scans[-1] = labelled_scan(crowd.time_s, lon_m.tolist(), lat_m.tolist(), [""] * 500)
    after = scripted_scans(separate_cars(), [crowd.time_s + STEP_S], rng)
    follow(build, scans + after)


def _check_impossible_detections_are_refused(build: Build) -> None:
    tracker = build(0)
    scans = scripted_scans(separate_cars(), times_every_step(1.0), np.random.default_rng(8))
    for labelled in scans[:-1]:
        step(tracker, labelled)
    good = scans[-1]
    for what, detections in impossible_versions(good.scan.detections):
        require_refusal(tracker, replace(good, scan=replace(good.scan, detections=detections)), what)
    step(tracker, good)


def _check_time_that_does_not_grow_is_refused(build: Build) -> None:
    tracker = build(0)
    scans = scripted_scans(separate_cars(), times_every_step(1.0), np.random.default_rng(9))
    for labelled in scans[:-1]:
        step(tracker, labelled)
    last_s = scans[-2].scan.time_s
    for time_s in (last_s, last_s - STEP_S, np.nan):
        wrong = replace(scans[-1], scan=replace(scans[-1].scan, time_s=time_s))
        require_refusal(tracker, wrong, f"time {time_s} s after {last_s} s")
    step(tracker, scans[-1])


def _check_steps_of_1_s(build: Build) -> None:
    cars = separate_cars()
    times_s = [*times_every_step(2.0), *np.arange(3.0, 9.0).tolist()]
    scans = scripted_scans(cars, times_s, np.random.default_rng(10))
    last = follow(build, scans)[-1]
    require(len(last) > 0, "no track of four cars in plain view is left after steps of 1 s")


def _check_identities_stay_on_a_bend(build: Build) -> None:
    _, cars, ego = bend_scene()
    _require_identities(build, cars, scans_in_plane(cars, ego, times_every_step(5.0), np.random.default_rng(13)))


def _check_identities_stay_at_a_crossing(build: Build) -> None:
    _, cars, ego = crossing_scene()
    _require_identities(build, cars, scans_in_plane(cars, ego, times_every_step(6.0), np.random.default_rng(14)))


def _content(detections: Detections) -> dict[str, bytes]:
    """Return the bytes of each column, those of sizes and headings included where they are measured."""
    parts = {"": detections, "sizes.": detections.sizes, "headings.": detections.headings}
    columns = {
        name + column.name: getattr(part, column.name)
        for name, part in parts.items()
        if part is not None
        for column in fields(part)
    }
    return {name: values.tobytes() for name, values in columns.items() if isinstance(values, np.ndarray)}
