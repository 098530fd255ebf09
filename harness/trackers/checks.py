"""A conformance suite for trackers, one's own included.

    from harness.trackers.checks import check_tracker, tracker_checks

    check_tracker(make_tracker)                     # all of them; raises with every finding

    @pytest.mark.parametrize("check", tracker_checks(), ids=str)
    def test_my_tracker(check):                     # or one test for each
        check(make_tracker)

``make_tracker`` is what ``--tracker package.module:make_tracker`` takes: a function of the setting and the options.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from harness.trackers.protocol import Tracker, TrackerFactory, TrackerSetting, TruthAssociatedTracker
from harness.trackers.scripted_scenes import (
    EGO_SPEED_MPS,
    EGO_START_M,
    ROAD,
    SENSOR,
    LabelledScan,
    ScriptedCar,
    ego_at,
    labelled_scan,
    scripted_scans,
    shuffled,
    without_sizes,
)
from mmpf.road import FloatArray
from mmpf.scan import BodySizes, Detections, InvalidScanError
from mmpf.state import CONFIRMED, HIDDEN, TENTATIVE, Tracks

AnyTracker = Tracker | TruthAssociatedTracker
Build = Callable[[int], AnyTracker]

_STEP_S = 0.1
_LANE_CENTRES_M = tuple(lane.centre_m for lane in ROAD.lanes)


class TrackerCheckError(AssertionError):
    """A tracker does not keep what the role promises; the message says what and when."""


@dataclass(frozen=True)
class TrackerCheck:
    """One check of the suite.

    Attributes:
        name: What must hold, as words joined by underscores.
        examine: The check itself, given a function that builds the tracker from a seed.
    """

    name: str
    examine: Callable[[Build], None]

    def __call__(self, make_tracker: TrackerFactory, options: Mapping[str, object] | None = None) -> None:
        """Examine a tracker.

        Raises:
            TrackerCheckError: The check failed.
        """

        def build(seed: int) -> AnyTracker:
            setting = TrackerSetting(road=ROAD, sensor=SENSOR, rng=np.random.default_rng(seed), step_s=_STEP_S)
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
    """Return all checks, for parametrised tests."""
    prefix = "_check_"
    return [TrackerCheck(examine.__name__.removeprefix(prefix), examine) for examine in _CHECKS]


def _check_tracks_are_well_formed(build: Build) -> None:
    _follow(build, _busy_scene())


def _check_one_car_becomes_one_confirmed_track(build: Build) -> None:
    car = ScriptedCar("car", EGO_START_M + 30.0, speed_mps=24.0)
    scans = scripted_scans([car], _times(3.0), np.random.default_rng(1))
    ids = set()
    for labelled, tracks in zip(scans, _follow(build, scans), strict=True):
        if labelled.scan.time_s < 1.0:
            continue
        confirmed = np.flatnonzero(tracks.state != TENTATIVE)
        _require(len(confirmed) == 1, f"{len(confirmed)} confirmed tracks of one car", labelled)
        time_s, track = labelled.scan.time_s, confirmed[0]
        error_m = float(np.hypot(tracks.lon_m[track] - car.lon_at(time_s), tracks.lat_m[track] - car.lat_m))
        _require(error_m < 1.0, f"the track is {error_m:.2f} m from its car", labelled)
        ids.add(int(tracks.track_id[track]))
    _require(len(ids) == 1, f"one car had the identities {sorted(ids)}")


def _check_identities_stay_with_their_cars(build: Build) -> None:
    cars = _separate_cars()
    scans = scripted_scans(cars, _times(5.0), np.random.default_rng(2), detection_probability=0.95)
    held: dict[str, set[int]] = {car.name: set() for car in cars}
    for labelled, tracks in zip(scans, _follow(build, scans), strict=True):
        if labelled.scan.time_s >= 1.5:
            for car in cars:
                held[car.name].add(_nearest_track(tracks, car, labelled))
    changed = {name: sorted(ids) for name, ids in held.items() if len(ids) > 1}
    _require(not changed, f"cars far apart changed identity: {changed}")


def _check_identities_are_never_used_again(build: Build) -> None:
    first = ScriptedCar("first", EGO_START_M + 60.0, lane=1, until_s=3.0)
    second = ScriptedCar("second", EGO_START_M - 60.0, lane=5, from_s=43.0)
    times_s = [*_times(3.0), *np.arange(4.0, 43.0).tolist(), *(43.0 + np.array(_times(3.0))).tolist()]
    scans = scripted_scans([first, second], times_s, np.random.default_rng(3))
    ids: dict[str, set[int]] = {"first": set(), "second": set()}
    for labelled, tracks in zip(scans, _follow(build, scans), strict=True):
        name = "first" if labelled.scan.time_s < 4.0 else "second" if labelled.scan.time_s >= 43.0 else None
        if name:
            ids[name] |= set(tracks.track_id[tracks.state == CONFIRMED].tolist())
    both = ids["first"] & ids["second"]
    _require(not both, f"identities {sorted(both)} were used again 40 s later for another car 120 m away")


def _check_equal_seeds_give_equal_tracks(build: Build) -> None:
    scans = _busy_scene()
    first = _follow(build, scans)
    # A tracker that draws from the global generator must be found out.
    np.random.random()  # noqa: NPY002
    second = _follow(build, scans)
    for labelled, one, other in zip(scans, first, second, strict=True):
        for column in fields(Tracks):
            same = getattr(one, column.name).tobytes() == getattr(other, column.name).tobytes()
            _require(same, f"two runs with equal seeds differ in {column.name}", labelled)


def _check_order_of_detections_means_nothing(build: Build) -> None:
    cars = _separate_cars()
    scans = scripted_scans(cars, _times(3.0), np.random.default_rng(4))
    mixed = [shuffled(labelled, np.arange(len(labelled.truth_id))[::-1]) for labelled in scans]
    pairs = zip(scans, _follow(build, scans), _follow(build, mixed), strict=True)
    for labelled, tracks, others in pairs:
        if labelled.scan.time_s < 1.0:
            continue
        counts = int((tracks.state == CONFIRMED).sum()), int((others.state == CONFIRMED).sum())
        _require(counts[0] == counts[1], f"{counts[0]} confirmed tracks, {counts[1]} in reversed order", labelled)
        for car in cars:
            one, other = _position(tracks, car, labelled), _position(others, car, labelled)
            distance_m = float(np.hypot(*(one - other)))
            _require(distance_m < 0.5, f"reversing the detections moves a track by {distance_m:.2f} m", labelled)


def _check_scans_are_left_as_they_were(build: Build) -> None:
    tracker = build(0)
    for labelled in _busy_scene()[:20]:
        before = _content(labelled.scan.detections)
        _step(tracker, labelled)
        after = _content(labelled.scan.detections)
        for name, content in before.items():
            _require(after[name] == content, f"the tracker wrote to detections.{name}", labelled)


def _check_sizes_need_not_be_measured(build: Build) -> None:
    scans = [
        without_sizes(labelled) for labelled in scripted_scans(_separate_cars(), _times(3.0), np.random.default_rng(12))
    ]
    last = _follow(build, scans)[-1]
    for car in _separate_cars():
        _nearest_index(last, car, scans[-1])


def _check_no_detections_for_5_s(build: Build) -> None:
    _follow(build, [labelled_scan(time_s, [], [], []) for time_s in _times(5.0)])
    cars = [replace(car, until_s=2.0) for car in _separate_cars()]
    cars += [replace(car, name=f"{car.name} again", from_s=7.0) for car in _separate_cars()]
    _follow(build, scripted_scans(cars, _times(8.0), np.random.default_rng(5)))


def _check_nothing_but_clutter(build: Build) -> None:
    _follow(build, scripted_scans([], _times(5.0), np.random.default_rng(6), clutter_per_scan=8.0))


def _check_two_detections_at_one_point(build: Build) -> None:
    scans = []
    for time_s in _times(2.0):
        lon_m = ego_at(time_s).lon_m + 25.0
        scans.append(labelled_scan(time_s, [lon_m, lon_m], [_LANE_CENTRES_M[1]] * 2, ["car", "car"]))
    _follow(build, scans)


def _check_500_detections(build: Build) -> None:
    rng = np.random.default_rng(7)
    scans = scripted_scans(_separate_cars(), _times(1.0), rng)
    crowd = scans[-1].scan
    lon_m = crowd.ego.lon_m + rng.uniform(-SENSOR.range_m, SENSOR.range_m, 500)
    lat_m = rng.uniform(0.0, 5 * 3.66, 500)
    scans[-1] = labelled_scan(crowd.time_s, lon_m.tolist(), lat_m.tolist(), [""] * 500)
    after = scripted_scans(_separate_cars(), [crowd.time_s + _STEP_S], rng)
    _follow(build, scans + after)


def _check_impossible_detections_are_refused(build: Build) -> None:
    tracker = build(0)
    scans = scripted_scans(_separate_cars(), _times(1.0), np.random.default_rng(8))
    for labelled in scans[:-1]:
        _step(tracker, labelled)
    good = scans[-1]
    for what, detections in _impossible(good.scan.detections):
        _require_refusal(tracker, replace(good, scan=replace(good.scan, detections=detections)), what)
    _step(tracker, good)


def _check_time_that_does_not_grow_is_refused(build: Build) -> None:
    tracker = build(0)
    scans = scripted_scans(_separate_cars(), _times(1.0), np.random.default_rng(9))
    for labelled in scans[:-1]:
        _step(tracker, labelled)
    last_s = scans[-2].scan.time_s
    for time_s in (last_s, last_s - _STEP_S, np.nan):
        wrong = replace(scans[-1], scan=replace(scans[-1].scan, time_s=time_s))
        _require_refusal(tracker, wrong, f"time {time_s} s after {last_s} s")
    _step(tracker, scans[-1])


def _check_steps_of_1_s(build: Build) -> None:
    cars = _separate_cars()
    times_s = [*_times(2.0), *np.arange(3.0, 9.0).tolist()]
    scans = scripted_scans(cars, times_s, np.random.default_rng(10))
    last = _follow(build, scans)[-1]
    _require(len(last) > 0, "no track of four cars in plain view is left after steps of 1 s")


_CHECKS: tuple[Callable[[Build], None], ...] = (
    _check_tracks_are_well_formed,
    _check_one_car_becomes_one_confirmed_track,
    _check_identities_stay_with_their_cars,
    _check_identities_are_never_used_again,
    _check_equal_seeds_give_equal_tracks,
    _check_order_of_detections_means_nothing,
    _check_scans_are_left_as_they_were,
    _check_sizes_need_not_be_measured,
    _check_no_detections_for_5_s,
    _check_nothing_but_clutter,
    _check_two_detections_at_one_point,
    _check_500_detections,
    _check_impossible_detections_are_refused,
    _check_time_that_does_not_grow_is_refused,
    _check_steps_of_1_s,
)


def _times(until_s: float) -> list[float]:
    return [round(step * _STEP_S, 6) for step in range(round(until_s / _STEP_S) + 1)]


def _separate_cars() -> list[ScriptedCar]:
    """Four cars, each alone within 30 m."""
    return [
        ScriptedCar("ahead", EGO_START_M + 40.0, lane=3, speed_mps=EGO_SPEED_MPS + 2.0),
        ScriptedCar("behind", EGO_START_M - 40.0, lane=3, speed_mps=EGO_SPEED_MPS - 1.0),
        ScriptedCar("left", EGO_START_M + 5.0, lane=1, speed_mps=EGO_SPEED_MPS + 3.0),
        ScriptedCar("right", EGO_START_M - 5.0, lane=5, speed_mps=EGO_SPEED_MPS - 3.0),
    ]


def _impossible(good: Detections) -> Iterator[tuple[str, Detections]]:
    """Return what no sensor can have measured, and what is wrong with it."""
    for name, value in (("lon_m", np.nan), ("lat_m", np.inf), ("std_lon_m", -1.0), ("std_lat_m", np.nan)):
        spoilt: dict[str, Any] = {name: _spoilt(getattr(good, name), value)}
        yield f"detections.{name} = {value}", replace(good, **spoilt)
    sizes = good.sizes
    assert sizes is not None
    for name, value in (("length_m", np.nan), ("width_m", -1.0), ("std_length_m", 0.0)):
        bad = replace(sizes, **{name: _spoilt(getattr(sizes, name), value)})
        yield f"detections.sizes.{name} = {value}", replace(good, sizes=bad)
    yield "columns of different lengths", replace(good, lat_m=good.lat_m[:-1])


def _spoilt(column: FloatArray, value: float) -> FloatArray:
    spoilt = column.copy()
    spoilt[0] = value
    return spoilt


def _content(detections: Detections) -> dict[str, bytes]:
    """Return the bytes of each column, those of the sizes included where they are measured."""
    columns = {f.name: getattr(detections, f.name) for f in fields(Detections) if f.name != "sizes"}
    if detections.sizes is not None:
        columns |= {f"sizes.{f.name}": getattr(detections.sizes, f.name) for f in fields(BodySizes)}
    return {name: values.tobytes() for name, values in columns.items()}


def _busy_scene() -> list[LabelledScan]:
    rng = np.random.default_rng(11)
    return scripted_scans(_separate_cars(), _times(4.0), rng, detection_probability=0.9, clutter_per_scan=1.0)


def _follow(build: Build, scans: Sequence[LabelledScan]) -> list[Tracks]:
    tracker = build(0)
    return [_step(tracker, labelled) for labelled in scans]


def _step(tracker: AnyTracker, labelled: LabelledScan) -> Tracks:
    try:
        tracks = _feed(tracker, labelled)
    except Exception as error:
        message = f"step raised {type(error).__name__}: {error}"
        raise TrackerCheckError(_at(message, labelled)) from error
    _require_well_formed(tracks, labelled)
    return tracks


def _feed(tracker: AnyTracker, labelled: LabelledScan) -> Tracks:
    if isinstance(tracker, TruthAssociatedTracker):
        return tracker.step_associated(labelled.scan, labelled.truth_id)
    return tracker.step(labelled.scan)


def _require_refusal(tracker: AnyTracker, labelled: LabelledScan, what: str) -> None:
    try:
        _feed(tracker, labelled)
    except InvalidScanError:
        return
    except Exception as error:
        message = f"{what} raised {type(error).__name__}, not InvalidScanError (call mmpf.scan.check_scan first)"
        raise TrackerCheckError(message) from error
    raise TrackerCheckError(f"{what} was taken in; it must raise InvalidScanError (call mmpf.scan.check_scan first)")


def _require_well_formed(tracks: Tracks, labelled: LabelledScan) -> None:
    _require(isinstance(tracks, Tracks), f"step returned {type(tracks).__name__}, not Tracks", labelled)
    for column in fields(Tracks):
        values, dtype = getattr(tracks, column.name), _column_type(column.name)
        _require(isinstance(values, np.ndarray), f"{column.name} is {type(values).__name__}, not an array", labelled)
        _require(values.shape == (len(tracks),), f"{column.name} has shape {values.shape}, not (m,)", labelled)
        _require(values.dtype == dtype, f"{column.name} is {values.dtype}, not {dtype}", labelled)
        _require(bool(np.isfinite(values).all()), f"{column.name} holds a value that is not finite", labelled)
    for name in ("std_lon_m", "std_lat_m", "std_speed_mps"):
        _require(bool((getattr(tracks, name) > 0.0).all()), f"{name} is not positive", labelled)
    inside = (tracks.existence >= 0.0) & (tracks.existence <= 1.0)
    _require(bool(inside.all()), "existence lies outside [0, 1]", labelled)
    known = np.isin(tracks.state, (TENTATIVE, CONFIRMED, HIDDEN))
    _require(bool(known.all()), "state is none of TENTATIVE, CONFIRMED and HIDDEN", labelled)
    _require(len(np.unique(tracks.track_id)) == len(tracks), "two tracks have one identity", labelled)


def _column_type(name: str) -> np.dtype[np.generic]:
    return np.dtype({"track_id": np.int64, "state": np.int8}.get(name, np.float64))


def _nearest_track(tracks: Tracks, car: ScriptedCar, labelled: LabelledScan) -> int:
    return int(tracks.track_id[_nearest_index(tracks, car, labelled)])


def _position(tracks: Tracks, car: ScriptedCar, labelled: LabelledScan) -> FloatArray:
    nearest = _nearest_index(tracks, car, labelled)
    return np.array([tracks.lon_m[nearest], tracks.lat_m[nearest]])


def _nearest_index(tracks: Tracks, car: ScriptedCar, labelled: LabelledScan) -> int:
    confirmed = np.flatnonzero(tracks.state != TENTATIVE)
    time_s = labelled.scan.time_s
    distance_m = np.hypot(tracks.lon_m[confirmed] - car.lon_at(time_s), tracks.lat_m[confirmed] - car.lat_m)
    _require(bool((distance_m < 3.0).any()), f"no confirmed track within 3 m of car {car.name!r}", labelled)
    return int(confirmed[np.argmin(distance_m)])


def _require(holds: bool, message: str, labelled: LabelledScan | None = None) -> None:
    if not holds:
        raise TrackerCheckError(message if labelled is None else _at(message, labelled))


def _at(message: str, labelled: LabelledScan) -> str:
    return f"at {labelled.scan.time_s:g} s, {len(labelled.scan.detections)} detections: {message}"
