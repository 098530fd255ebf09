"""What lies in the ego's path is reported with any probability; elsewhere a component must be a probable vehicle."""

import numpy as np
import pytest

from mmpf.belief.moments import component_moments
from mmpf.joint.confirmation import is_improbable, least_probabilities, still_confirmed, to_confirm
from mmpf.joint.kinds import MOVING, SHAPE, STANDING, VEHICLE
from mmpf.options.filter import ReportingOptions
from mmpf.options.joint import JointOptions
from mmpf.stages.reporting import reported_tracks
from tests.mmpf.scenes import belief_of, ego_at, lane_centre, spot
from tests.mmpf.test_update_rules import situation_with

OPTIONS = JointOptions()
LANE = lane_centre(2)
IN_PATH, AHEAD, ELSEWHERE = (0.0, 0.0), (0.2, 0.08), (0.5, 0.2)


def place(lon_m: float, lat_m: float, speed_mps: float = 20.0) -> tuple[float, float]:
    mixture = belief_of([spot(lon_m, lat_m)])
    plane = situation_with([]).plane
    plane = type(plane)(ego_at(speed_mps=speed_mps), plane.road)
    confirm, keep = least_probabilities(mixture.components, component_moments(mixture), plane, OPTIONS)
    return confirm[0], keep[0]


def test_the_path_is_the_egos_lane_as_far_as_it_needs_to_stop() -> None:
    stop_m = OPTIONS.path.gap_m + OPTIONS.path.reaction_s * 20.0 + 20.0**2 / (2.0 * OPTIONS.path.braking_mps2)
    assert place(stop_m - 1.0, LANE) == IN_PATH
    assert place(stop_m + 1.0, LANE) == ELSEWHERE
    assert place(-5.0, LANE) == ELSEWHERE
    assert place(stop_m - 1.0, lane_centre(3)) == AHEAD
    assert place(30.0, LANE + 9.0) == ELSEWHERE
    assert place(30.0, LANE, speed_mps=0.0) == ELSEWHERE


def test_a_single_flash_is_reported_nowhere() -> None:
    flash = belief_of([spot(30.0, LANE)], confirmed=[False], existence=[0.95], detected_s=[0.0]).components
    assert not to_confirm(flash, np.zeros(1), OPTIONS)[0]


@pytest.mark.parametrize(
    ("path", "stood_log", "detected_s", "reported"),
    [(IN_PATH, 0.0, 1.0, True), (AHEAD, 0.0, 1.0, False), (AHEAD, -20.0, 0.8, True), (AHEAD, -20.0, 0.5, False),
     (AHEAD, -1.0, 9.0, False)],
)  # fmt: skip
def test_what_is_probably_false_is_reported_in_the_path_or_when_it_has_moved_for_long_and_nowhere_else(
    path, stood_log, detected_s, reported
) -> None:
    false = np.zeros((1, *SHAPE))
    false[:, STANDING, 0, 2] = 1.0
    columns = {"existence": [0.95], "detected_s": [detected_s], "kinds": false, "stood_log": [stood_log]}
    tentative = belief_of([spot(30.0, LANE)], confirmed=[False], **columns).components
    confirmed = belief_of([spot(30.0, LANE)], confirmed=[True], **columns).components
    assert to_confirm(tentative, np.array(path[:1]), OPTIONS)[0] == reported
    improbable = is_improbable(confirmed, np.array(path[1:]), OPTIONS)
    assert still_confirmed(confirmed, improbable, OPTIONS)[0] == reported


@pytest.mark.parametrize(("vehicle", "at", "shown"), [(0.04, AHEAD, False), (0.04, IN_PATH, True), (0.1, AHEAD, True)])
def test_what_has_moved_but_is_probably_false_stays_a_track_and_is_shown_only_in_the_path(vehicle, at, shown) -> None:
    kinds = np.zeros((1, *SHAPE))
    kinds[:, [VEHICLE, MOVING], 0, 2] = vehicle, 1.0 - vehicle
    columns = {"existence": [0.95], "detected_s": [3.0], "kinds": kinds, "stood_log": [-20.0]}
    known = belief_of([spot(30.0, LANE)], confirmed=[True], **columns)
    improbable = is_improbable(known.components, np.array(at[1:]), OPTIONS)
    assert still_confirmed(known.components, improbable, OPTIONS)[0]
    mixture = belief_of([spot(30.0, LANE)], confirmed=[True], improbable=improbable)
    tracks = reported_tracks(mixture, component_moments(mixture), ReportingOptions(), situation_with([]).sensor)
    assert len(tracks.track_id) == shown


@pytest.mark.parametrize(
    ("vehicle", "where", "confirmed", "kept"),
    [(0.6, ELSEWHERE, True, True), (0.4, ELSEWHERE, False, True), (0.1, ELSEWHERE, False, False),
     (0.3, AHEAD, True, True), (0.1, AHEAD, False, True), (0.05, AHEAD, False, False)],
)  # fmt: skip
def test_ahead_of_the_ego_less_probable_vehicles_are_reported(vehicle, where, confirmed, kept) -> None:
    kinds = np.zeros((1, *SHAPE))
    kinds[:, [VEHICLE, STANDING], 0, 2] = vehicle, 1.0 - vehicle
    columns = {"existence": [0.99], "detected_s": [1.0], "kinds": kinds}
    tentative, known = (belief_of([spot(30.0, LANE)], confirmed=[was], **columns).components for was in (False, True))
    assert to_confirm(tentative, np.array(where[:1]), OPTIONS)[0] == confirmed
    assert still_confirmed(known, is_improbable(known, np.array(where[1:]), OPTIONS), OPTIONS)[0] == kept
