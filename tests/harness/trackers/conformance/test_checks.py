from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from harness.trackers.conformance.checks import check_tracker, tracker_checks
from harness.trackers.conformance.plane_scenes import bend_scene, crossing_scene
from harness.trackers.conformance.requirements import TrackerCheckError
from harness.trackers.conformance.scripted_scenes import SENSOR
from harness.trackers.oracle import build_oracle_kalman
from mmpf.tracks import Tracks


class Sabotaged:
    """The oracle, which passes every check, with one fault."""

    def __init__(self, setting, options, spoil_scan=None, spoil_tracks=None):
        self.oracle = build_oracle_kalman(setting, options)
        self.spoil_scan = spoil_scan or (lambda scan: scan)
        self.spoil_tracks = spoil_tracks or (lambda tracks: tracks)

    def step_associated(self, scan, truth_id):
        return self.spoil_tracks(self.oracle.step_associated(self.spoil_scan(scan), truth_id))


def overwrite_first_position(scan):
    scan.detections.lon_m[:1] += 1e-9
    return scan


def overwrite_first_length(scan):
    if scan.detections.sizes is not None and len(scan.detections):
        scan.detections.sizes.length_m[0] += 1e-9
    return scan


def round_up_sizes(scan):
    sizes = scan.detections.sizes
    if sizes is None:
        return scan
    columns = {name: np.maximum(np.nan_to_num(values), 0.1) for name, values in vars(sizes).items()}
    return replace(scan, detections=replace(scan.detections, sizes=replace(sizes, **columns)))


def rely_on_sizes(scan):
    return scan if scan.detections.sizes.length_m.all() else None


def clean_up(scan):
    detections = scan.detections
    finite = np.isfinite(detections.lon_m[: len(detections.lat_m)]) & np.isfinite(detections.lat_m)
    columns = {name: np.where(finite, getattr(detections, name)[: len(finite)], 1.0) for name in ("lon_m", "lat_m")}
    return replace(scan, detections=replace(detections, **columns))


def with_column(name: str, change: Callable) -> Callable[[Tracks], Tracks]:
    return lambda tracks: replace(tracks, **{name: change(getattr(tracks, name))})


def draw_from_the_global_generator(tracks: Tracks) -> Tracks:
    return replace(tracks, lon_m=tracks.lon_m + 1e-6 * np.random.random(len(tracks)))  # noqa: NPY002


def number_by_chance() -> Callable[[Tracks], Tracks]:
    rng = np.random.default_rng(0)
    return lambda tracks: replace(tracks, track_id=rng.permutation(10_000)[: len(tracks)].astype(np.int64))


@pytest.mark.parametrize(
    ("check", "faults"),
    [
        ("tracks_are_well_formed", {"spoil_tracks": with_column("state", lambda state: state.astype(np.int64))}),
        ("tracks_are_well_formed", {"spoil_tracks": with_column("std_lon_m", lambda std: std * 0.0)}),
        ("tracks_are_well_formed", {"spoil_tracks": with_column("speed_mps", lambda speed: speed * np.nan)}),
        ("tracks_are_well_formed", {"spoil_tracks": with_column("existence", lambda share: share + 0.1)}),
        ("tracks_are_well_formed", {"spoil_tracks": with_column("track_id", lambda ids: ids * 0)}),
        ("tracks_are_well_formed", {"spoil_tracks": lambda tracks: None}),
        ("one_car_becomes_one_confirmed_track", {"spoil_tracks": with_column("lon_m", lambda lon: lon + 2.0)}),
        ("one_car_becomes_one_confirmed_track", {"spoil_tracks": with_column("state", lambda state: state * 0)}),
        ("identities_stay_with_their_cars", {"spoil_tracks": number_by_chance()}),
        ("identities_stay_on_a_bend", {"spoil_tracks": number_by_chance()}),
        ("identities_stay_on_a_bend", {"spoil_tracks": with_column("lat_m", lambda lat: lat * 0.0)}),
        ("identities_stay_at_a_crossing", {"spoil_tracks": with_column("lat_m", lambda lat: lat * 0.0)}),
        ("identities_are_never_used_again", {"spoil_tracks": with_column("track_id", lambda ids: np.arange(len(ids)))}),
        ("equal_seeds_give_equal_tracks", {"spoil_tracks": draw_from_the_global_generator}),
        ("scans_are_left_as_they_were", {"spoil_scan": overwrite_first_position}),
        ("scans_are_left_as_they_were", {"spoil_scan": overwrite_first_length}),
        ("sizes_need_not_be_measured", {"spoil_scan": rely_on_sizes}),
        ("500_detections", {"spoil_scan": lambda scan: [scan][len(scan.detections) // 400]}),
        ("impossible_detections_are_refused", {"spoil_scan": clean_up}),
        ("impossible_detections_are_refused", {"spoil_scan": round_up_sizes}),
    ],
)
def test_a_fault_is_found_by_the_check_for_it(check: str, faults: dict[str, Callable]):
    chosen = next(candidate for candidate in tracker_checks() if candidate.name == check)
    with pytest.raises(TrackerCheckError):
        chosen(lambda setting, options: Sabotaged(setting, options, **faults))


class Forgetful:
    """A tracker that lets time run backwards and can't bear an empty scan."""

    def __init__(self, setting, options):
        self.tracker = build_oracle_kalman(setting, options)
        self.steps = 0

    def step_associated(self, scan, truth_id):
        self.steps += 1
        if not len(scan.detections):
            raise IndexError("no detections")
        return self.tracker.step_associated(replace(scan, time_s=0.1 * self.steps), truth_id)


def test_the_suite_reports_every_finding_with_its_time_and_cause():
    with pytest.raises(TrackerCheckError) as findings:
        check_tracker(Forgetful)
    text = str(findings.value)
    assert "no_detections_for_5_s: at 0 s, 0 detections: step raised IndexError: no detections" in text
    assert "time_that_does_not_grow_is_refused: time 0.9 s after 0.9 s was taken in" in text


class OrderMinded:
    """Follows only the first detection of each scan."""

    def __init__(self, setting, options):
        self.tracker = build_oracle_kalman(setting, options)

    def step_associated(self, scan, truth_id):
        first = np.where(np.arange(len(truth_id)) < len(truth_id) / 2, truth_id, "")
        return self.tracker.step_associated(scan, first)


def test_a_tracker_that_follows_the_order_of_detections_is_found():
    chosen = next(check for check in tracker_checks() if check.name == "order_of_detections_means_nothing")
    with pytest.raises(TrackerCheckError):
        chosen(OrderMinded)


def test_cars_of_the_scenes_in_the_plane_are_apart_in_range_and_on_their_lanes():
    for road, cars, ego in (bend_scene(), crossing_scene()):
        for time_s in np.arange(0.0, 6.0, 0.1):
            places = np.array([car.place_at(time_s) for car in [*cars, ego]])
            away = np.hypot(*(places[:, None] - places).transpose(2, 0, 1)) + 1e3 * np.eye(len(places))
            assert away.min() > 3.0
            assert away[-1, :-1].max() < SENSOR.range_m
            near = road.graph.lanes_near(*places.T)
            assert np.abs(near.left_m[:, 0]).max() < 0.01
